"""
Run the commands of docs/first_hour.md again, and write their output into the page.

    python3 docs/make_first_hour.py [--recordings FOLDER]

The commands are those of the page, in an empty folder. FOLDER contains the public recordings of
real arms; without it their part of the page is kept, with its note on an earlier estimator, which
a run with FOLDER makes obsolete. `...` replaces the sections of an output that are not shown.
"""

from __future__ import annotations

import argparse
from contextlib import chdir, redirect_stderr, redirect_stdout
import io
import os
from pathlib import Path
import re
import shlex
import shutil
import tempfile
import textwrap

from gravity_comp_ros.cli import main as gravity_comp
import numpy as np

PAGE = Path(__file__).resolve().parent / 'first_hour.md'
REAL = '## Recordings of real arms'
WIDTH = 110
# First words of the sections of an output that the page shows, by verb; '' is the first section.
# An output without such a section is shown as a whole.
SHOWN = {'synth': (), 'convert': ('',), 'info': ('',), 'fit': ('chain',),
         'compare': ('error of the model', 'worst joint'),
         'diagnose': ('', 'missing effects'), 'add': ('held-out error', 'added')}
# The same in the part of real arms.
SHOWN_OF_REAL = {'convert': (), 'fit': (), 'diagnose': ('',)}
Shown = dict[str, tuple[str, ...]]


def page(text: str, folder: Path, recordings: Path | None = None) -> str:
    """Return the page with the output of its commands, run in a folder."""
    os.environ['COLUMNS'] = str(WIDTH)
    simulated, title, real = text.partition(REAL)
    with chdir(folder):
        write_table(Path('my_log.csv'))
        simulated = with_outputs(simulated, SHOWN)
        if recordings is not None:
            for path in (*recordings.rglob('*_exciting_trajectory.db3'),
                         *recordings.rglob('measurements.csv')):
                shutil.copy(path, path.name)
            real = with_outputs(real, SHOWN_OF_REAL)
    return simulated + title + real


def with_outputs(text: str, shown: Shown) -> str:
    """Return a text with the outputs of the commands in its blocks."""
    def block(match: re.Match[str]) -> str:
        lines = []
        for command in re.findall(r'^\$ (gravity_comp .*)$', match[0], re.MULTILINE):
            output = excerpt(run(command), shown[command.split()[1]])
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


def write_table(path: Path) -> None:
    """Write a table of an arm with three joints in the format of a logger."""
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
    tau += np.array([0.6, 0.0, 0.4]) * np.tanh(qd / 0.003) + 0.03 * rng.normal(size=tau.shape)
    names = [f'{joint}_{kind}' for kind in ('pos', 'eff')
             for joint in ('base', 'shoulder', 'elbow')]
    rows = np.column_stack([np.round(1000 * t), np.degrees(q), tau])
    path.write_text('\n'.join([';'.join(['t', *names]), *(
        ';'.join(f'{x:.5g}'.replace('.', ',') for x in row) for row in rows)]) + '\n')


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--recordings', type=Path)
    recordings = parser.parse_args().recordings
    with tempfile.TemporaryDirectory() as folder:
        PAGE.write_text(page(PAGE.read_text(encoding='utf-8'), Path(folder),
                             recordings and recordings.resolve()), encoding='utf-8')


if __name__ == '__main__':
    main()
