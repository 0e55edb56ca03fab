"""Tables with untruncated names and numbers at every width, in a terminal and a pipe."""

import os
from pathlib import Path
import pty
import re
import select
import subprocess
import sys

from gravity_comp_ros.cli import main
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.commands.screen_table import ScreenTable, wrapped
from hypothesis import given, settings, strategies as st
import pytest
from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

BAGS = Path(__file__).resolve().parents[2] / 'bags'
JOINTS = [f'left_arm_shoulder_lift_joint_{n}' for n in range(1, 8)]
NUMBER = re.compile(r'-?\d+\.\d+')


def printed(table, width):
    console = Console(width=width, highlight=False, emoji=False)
    with console.capture() as caught:
        console.print(table)
    return caught.get()


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Return a recording of an arm with long names, and its model."""
    folder = tmp_path_factory.mktemp('wide')
    bag, model = str(folder / 'wide.mcap'), str(folder / 'arm.json')
    assert main(['synth', '--noise', '0.1', '--joint-names', ','.join(JOINTS), '-o', bag]) == 0
    assert main(['fit', bag, '-o', model]) == 0
    return bag, model


@pytest.mark.parametrize('width', [60, 80, 120])
@pytest.mark.parametrize('verb', ['info', 'compare', 'fit'])
def test_a_verb_shows_untruncated_names_and_numbers(files, verb, width, monkeypatch, capsys):
    bag, model = files
    argv = [verb, bag, *(['--model', model] if verb == 'compare' else [])]
    monkeypatch.setenv('COLUMNS', '1000')
    assert main(argv) == 0
    wide = capsys.readouterr().out
    monkeypatch.setenv('COLUMNS', str(width))
    assert main(argv) == 0
    output = capsys.readouterr().out
    for joint in JOINTS:
        assert joint in output
    seconds = re.compile(r'in \d+\.\d+ s')   # the time of a fit varies
    numbers = [sorted(NUMBER.findall(seconds.sub('', text))) for text in (output, wide)]
    assert numbers[0] == numbers[1]
    table_lines = [line for line in output.splitlines() if bag not in line]
    assert max(map(cell_len, table_lines)) <= width


def test_in_a_pipe_each_joint_has_one_row(files, capsys):
    bag, model = files
    assert main(['compare', bag, '--model', model]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines()
            if line.startswith(' left_arm_shoulder_lift_joint_3')]
    assert len(rows) == 1 and len(NUMBER.findall(rows[0])) >= 6


def test_in_a_terminal_of_60_columns(files):
    bag, _ = files
    master, slave = pty.openpty()
    environment = {k: v for k, v in os.environ.items() if k != 'COLUMNS'}
    environment.update(TERM='xterm', PYTHONPATH=str(BAGS.parent))
    subprocess.run(['stty', 'cols', '60', 'rows', '40'], stdin=slave, check=True)
    child = subprocess.Popen([sys.executable, '-m', 'gravity_comp_ros.cli', 'info', bag],
                             stdin=slave, stdout=slave, stderr=slave, env=environment)
    os.close(slave)
    text = b''
    while select.select([master], [], [], 60)[0]:
        try:
            text += os.read(master, 65536)
        except OSError:   # raised on Linux when the other end is closed
            break
    assert child.wait(60) == 0
    os.close(master)
    output = re.sub(r'\x1b\[[0-9;?]*[A-Za-z]|\r', '', text.decode())
    for joint in JOINTS:
        assert joint in output
    assert len(NUMBER.findall(output)) > 7 * 7


CELL = st.text('abcdefghij_0123456789', min_size=1, max_size=24)


@settings(max_examples=60, deadline=None)
@given(st.data(), st.integers(20, 140))
def test_no_cell_is_truncated_at_any_width(data, width):
    columns = data.draw(st.integers(1, 9))
    headings = [f'h{k} ' + data.draw(CELL) for k in range(columns)]
    rows = data.draw(st.lists(st.lists(CELL, min_size=columns, max_size=columns), min_size=1,
                              max_size=4))
    keys = data.draw(st.integers(1, columns))
    table = ScreenTable('title', headings, [[Text(c) for c in row] for row in rows], keys=keys)
    output = printed(table, width)
    for row in rows:
        for cell in row:
            # Only words wider than the screen may be folded.
            assert cell in output or len(cell) + 3 > width or len(max(headings, key=len)) > width
    assert all(cell_len(line) <= width for line in output.splitlines())


def test_a_cell_wider_than_the_screen_is_folded_not_truncated():
    name = 'very_long_name_' * 4
    output = printed(terminal.table('', ['joint', 'x'], [[name, '1.25']]), 30)
    assert name in re.sub(r'\s', '', output) and '1.25' in output


@given(st.lists(st.text('abc.1', min_size=1, max_size=12), min_size=1, max_size=30),
       st.integers(0, 6), st.integers(24, 120))
def test_wrapped_lines_keep_the_words_in_order(words, lead, width):
    line = Text(' ' * lead + ' '.join(words))
    parts = [part.plain for part in wrapped(line, width)]
    assert ' '.join(parts).split() == words
    longest = max(map(len, words))
    assert all(len(part) <= max(width, lead + 4 + longest) for part in parts)


def test_a_number_is_not_separated_from_its_unit():
    for width in range(20, 60):
        parts = [p.plain for p in wrapped(Text('RMSE 11.5 N·m, at 99.8 s: 12.3 % of it'), width)]
        for whole in ('11.5 N·m', '99.8 s', '12.3 %'):
            assert any(whole in part for part in parts)


def test_a_command_is_never_broken(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '40')
    command = 'gravity_comp fit ' + ' '.join(f'run_{n}.mcap' for n in range(20))
    terminal.show_command(command)
    assert capsys.readouterr().out == f'  {command}\n'
