"""Terminal output: tables of any width, commands, and progress in a log."""

import re

from gravity_comp_ros.cli import main
from gravity_comp_ros.commands import terminal
import pytest
from rich.cells import cell_len

JOINTS = [f'left_arm_shoulder_lift_joint_{n}' for n in range(1, 8)]
NUMBER = re.compile(r'-?\d+\.\d+')


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Return a recording of an arm with long names, and its model."""
    folder = tmp_path_factory.mktemp('wide')
    bag, model = str(folder / 'wide.mcap'), str(folder / 'arm.json')
    assert main(['synth', '--noise', '0.1', '--duration', '12', '--joint-names', ','.join(JOINTS),
                 '-o', bag]) == 0
    assert main(['fit', bag, '-o', model, '--formulation', 'per_joint']) == 0
    return bag, model


@pytest.mark.parametrize('verb', ['info', 'compare'])
def test_names_and_numbers_are_whole_on_a_screen_of_any_width(files, verb, monkeypatch, capsys):
    bag, model = files
    argv = [verb, bag, *(['--model', model] if verb == 'compare' else [])]

    def shown(width):
        monkeypatch.setenv('COLUMNS', str(width))
        assert main(argv) == 0
        output = capsys.readouterr().out
        assert all(joint in output for joint in JOINTS)
        return output

    wide = shown(1000)
    narrow, fitting = shown(60), shown(120)
    for text in (narrow, fitting):
        assert sorted(NUMBER.findall(text)) == sorted(NUMBER.findall(wide))
    # A table that fits is not wider than the screen.
    assert max(cell_len(line.rstrip()) for line in fitting.splitlines() if bag not in line) <= 120


def test_in_a_pipe_each_joint_has_one_row(files, capsys):
    bag, model = files
    assert main(['compare', bag, '--model', model]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines()
            if line.startswith(' left_arm_shoulder_lift_joint_3')]
    assert len(rows) == 1 and len(NUMBER.findall(rows[0])) == 5


@pytest.mark.parametrize('width', [20, 34, 50, 90])
def test_no_cell_and_no_word_of_a_heading_is_cut(width, monkeypatch, capsys):
    monkeypatch.setenv('COLUMNS', str(width))
    name, text = 'very_long_name_' * 2, 'F_c = 0.83 N·m (0.77 to 0.88), F_v = 1.2 N·m s/rad'
    terminal.show(terminal.table('', ['joint', 'RMSE in training', 'coefficients', 'x'],
                                 [[name, '1.25', text, '-0.5']], left=('coefficients',)))
    output = capsys.readouterr().out
    for word in (name, '1.25', '-0.5', 'RMSE', 'training', 'coefficients', *text.split()):
        assert word in output
    assert max(cell_len(line.rstrip()) for line in output.splitlines()) <= max(width, 79)


def test_a_command_is_never_broken(capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '40')
    command = 'gravity_comp fit ' + ' '.join(f'run_{n}.mcap' for n in range(20))
    terminal.show(terminal.command(command))
    assert capsys.readouterr().out == f'  {command}\n'


@pytest.mark.parametrize('delay, lines', [
    (3600.0, ''), (0.0, '... read [red]a\n... fit\n')])
def test_long_work_prints_each_stage_once_in_a_log(capsys, monkeypatch, delay, lines):
    monkeypatch.setattr(terminal, '_PROGRESS_DELAY', delay)
    with terminal.progress() as report:
        for stage, fraction in (('read [red]a', 0.0), ('read [red]a', 0.5), ('fit', 0.6)):
            report(stage, fraction)
    assert capsys.readouterr().err == lines
