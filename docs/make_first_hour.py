"""
Run the commands of docs/first_hour.md and docs/tables.md again, and write their output there.

    python3 docs/make_first_hour.py

The commands are those of a page, in an empty folder. `...` replaces the sections of an output that
are not shown.
"""

from __future__ import annotations

from contextlib import chdir, redirect_stderr, redirect_stdout
import io
import json
import os
from pathlib import Path
import re
import shlex
import tempfile
import textwrap

from gravity_comp_ros.cli import main as gravity_comp
from gravity_comp_ros.data.samples import FloatArray
import numpy as np

PAGE = Path(__file__).resolve().parent / 'first_hour.md'
TABLES = PAGE.with_name('tables.md')
WIDTH = 110
# First words of the sections of an output that the page shows, by verb; '' is the first section.
# An output without such a section is shown as a whole.
SHOWN = {'synth': (), 'convert': ('',), 'info': ('',), 'fit': ('chain',),
         'compare': ('error of the model', 'worst joint'),
         'diagnose': ('', 'missing effects'), 'add': ('held-out error', 'added')}


def page(text: str, folder: Path) -> str:
    """Return the page with the output of its commands, run in a folder."""
    os.environ['COLUMNS'] = str(WIDTH)
    with chdir(folder):
        write_table(Path('my_log.csv'))
        return with_outputs(text)


def tables_page(text: str, folder: Path) -> str:
    """Return the page on tables with the output of its commands, run in a folder."""
    os.environ['COLUMNS'] = str(WIDTH)
    with chdir(folder):
        write_data_set(Path('pick_cubes'))
        write_currents(Path('currents.csv'))
        return with_outputs(text)


def with_outputs(text: str) -> str:
    """Return a text with the outputs of the commands in its blocks."""
    def block(match: re.Match[str]) -> str:
        lines = []
        for command in re.findall(r'^\$ (gravity_comp .*)$', match[0], re.MULTILINE):
            output = excerpt(run(command), SHOWN[command.split()[1]])
            lines += [f'$ {command}', *map(wrapped, output)]
        return '\n'.join(['```', *lines, '```'])
    return re.sub(r'^```\n\$ gravity_comp .*?^```', block, text, flags=re.DOTALL | re.MULTILINE)


def run(command: str) -> str:
    """Return the output of a command in the current folder."""
    text = io.StringIO()
    with redirect_stdout(text), redirect_stderr(text):
        gravity_comp(shlex.split(command)[1:])
    return text.getvalue()


def excerpt(output: str, shown: tuple[str, ...]) -> list[str]:
    """
    Return the lines of the sections of an output that begin with some words.

    A section begins after an empty line, at a line that is not indented.
    """
    text = '\n'.join(line.rstrip() for line in output.strip().splitlines()
                     if not line.startswith('... '))   # progress
    sections = re.split(r'\n\n+(?=\S)', text)
    chosen = [any(section.startswith(word) if word else not number for word in shown)
              for number, section in enumerate(sections)]
    lines: list[str] = []
    for section, is_shown in zip(sections, chosen):
        if is_shown or shown and not any(chosen):
            lines += [*([''] if lines and lines[-1] != '...' else []), *section.splitlines()]
        elif shown and lines[-1:] != ['...']:
            lines.append('...')
    return lines


def wrapped(line: str) -> str:
    """Return a wrapped line, with continuation lines indented further. Commands stay whole."""
    if line.startswith('  gravity_comp '):
        return line
    indent = ' ' * (len(line) - len(line.lstrip()) + 4)
    return textwrap.fill(line, WIDTH, subsequent_indent=indent, break_long_words=False,
                         break_on_hyphens=False)


def three_joints(friction: tuple[float, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times (M,) in s, angles (M, 3) in rad and torques (M, 3) in N·m of an arm."""
    rng = np.random.default_rng(1)
    t = np.arange(6000) / 50.0
    q, qd = np.zeros((2, len(t), 3))
    for joint in range(3):
        for size, omega in zip(rng.uniform(0.14, 0.35, 3), rng.uniform(0.08, 0.22, 3)):
            phase = rng.uniform(0, 2 * np.pi)
            q[:, joint] += size * np.sin(omega * t + phase)
            qd[:, joint] += size * omega * np.cos(omega * t + phase)
    # Gravity of two heavy links, Coulomb friction and noise, in N·m.
    fore = 5.0 * np.sin(q[:, 1] + q[:, 2])
    tau = np.column_stack([np.zeros(len(t)), 12.0 * np.sin(q[:, 1]) + fore, fore])
    tau += np.array(friction) * np.tanh(qd / 0.003) + 0.03 * rng.normal(size=tau.shape)
    return t, q, tau


def write_table(path: Path) -> None:
    """Write a table of an arm with three joints in the format of a logger."""
    t, q, tau = three_joints((0.6, 0.0, 0.4))
    names = [f'{joint}_{kind}' for kind in ('pos', 'eff')
             for joint in ('base', 'shoulder', 'elbow')]
    rows = np.column_stack([np.round(1000 * t), np.degrees(q), tau])
    path.write_text('\n'.join([';'.join(['t', *names]), *(
        ';'.join(f'{x:.5g}'.replace('.', ',') for x in row) for row in rows)]) + '\n')


def write_data_set(folder: Path) -> None:
    """Write a LeRobot data set of an arm with three joints and a gripper: degrees, per mille."""
    import pyarrow
    from pyarrow import parquet
    t, q, tau = three_joints((0.3, 0.5, 0.2))
    grip = 20 + 20 * np.sign(np.sin(t))
    columns = {'pos': np.column_stack([np.degrees(q), grip]),
               'load': np.column_stack([np.round(1000 * tau / [10, 30, 10]), 3 * grip])}
    names = [f'{joint}.{kind}' for kind in columns
             for joint in ('shoulder_pan', 'shoulder_lift', 'elbow_flex', 'gripper')]
    data = folder / 'data' / 'chunk-000'
    data.mkdir(parents=True)
    (folder / 'meta').mkdir()
    (folder / 'meta' / 'info.json').write_text(
        json.dumps({'features': {'observation.state': {'names': names}}}))
    parquet.write_table(pyarrow.table({
        'observation.state': list(np.hstack(list(columns.values()))), 'timestamp': t % 60.0,
        'episode_index': (t // 60.0).astype(int)}), data / 'file-000.parquet')


def write_currents(path: Path) -> None:
    """Write a table of an arm with three joints: motor currents in mA, motors of gear 1:100."""
    t, q, tau = three_joints((0.6, 0.8, 0.4))
    current = 1000 * tau / (100 * np.array([0.05, 0.05, 0.03]))
    names = [f'{kind}_{joint}' for kind in ('angle', 'current') for joint in (1, 2, 3)]
    np.savetxt(path, np.column_stack([t, q, current]), '%.6g', ',',
               header=','.join(['time', *names]), comments='')


def main() -> None:
    """Write the pages."""
    for path, renewed in ((PAGE, page), (TABLES, tables_page)):
        with tempfile.TemporaryDirectory() as folder:
            path.write_text(renewed(path.read_text(encoding='utf-8'), Path(folder)),
                            encoding='utf-8')


if __name__ == '__main__':
    main()
