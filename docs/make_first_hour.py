"""
Make docs/first_hour.md: what a new user types in the first hour, what is printed, and when.

    python3 docs/make_first_hour.py RECORDINGS [--set-up] [--test-log FILE] [--only WORD]

RECORDINGS is a folder that has the three public recordings somewhere in it. After the first
command of each part the script types nothing of its own: it runs the command that was printed as
the next step. With --set-up it begins with a fresh clone and `make demo`, and all else runs in the
environment that this makes. FILE is what `make test` printed. With --only, only the parts with
this word in their title are made, and the others stay as they are.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
import os
from pathlib import Path
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time

from first_hour_files import write_bag, write_table
from make_walkthrough import ROOT, STEPS, wrapped

PAGE = ROOT / 'docs' / 'first_hour.md'
_WIDTH = 110
# How many printed commands are followed in each part, fewer where each takes long.
_FOLLOWED, _FOLLOWED_REAL, _FOLLOWED_TABLE = 6, 4, 3

HEAD = """\
# The first hour

Made by `python3 docs/make_first_hour.py`, which ran every command on this page and put here what
it printed, warnings and errors included. Long lines are wrapped, and `[...]` stands for lines that
are left out: equations, what a recording cannot show, progress. After the first command of each
part every command is the one that the command before it printed as the next step. Parts with real
recordings end after a few, before nothing is left to do. The time in brackets is that of the
command, from its start to its end.
"""
REAL = (
    ('A recording of a real UR10', 'ur10_exciting_trajectory.db3',
     'From unisa-acg/inverse-dynamics-solver (BSD-3): 27 s of a motion made for identification,\n'
     'at up to 2.2 rad/s. The effort is motor current times gains.'),
    ('A recording of a real Franka Panda', 'panda_exciting_trajectory.db3',
     'From the same project: 24 s at 30 Hz, with the torque sensors of the joints.'),
    ('A table of a real KUKA LBR Med 7', 'measurements.csv',
     'From lbr-stack/dynamic_parameter_identification (MIT): 16 s at 100 Hz, without times; the\n'
     'arm stands still for the first 6.5 s. The torques have the opposite sign; the table does\n'
     'not say so.'))


SET_UP, WALK, TESTS = 'Setting up', 'The walk-through', 'All tests'
OWN_TABLE, OWN_BAG = 'A table of your own', 'A bag of your own'
ORDER = (SET_UP, WALK, OWN_TABLE, OWN_BAG, *(title for title, _, _ in REAL), TESTS)


@dataclass
class Session:
    """Commands run one after another in a folder; `parts` is the page so far."""

    folder: Path
    program: tuple[str, ...]
    parts: list[str] = field(default_factory=list)
    times: list[tuple[str, float]] = field(default_factory=list)

    def begin(self, title: str, prose: str) -> None:
        """Begin a part of the page."""
        self.parts.append(f'## {title}\n\n{prose}\n')
        self.times.append((title, 0.0))

    def say(self, prose: str) -> None:
        """Put a sentence between commands."""
        self.parts.append(f'{prose}\n')

    def run(self, command: str) -> str:
        """Run a command of this package, show it, and return what it printed."""
        return self.shell(command, [*self.program, *shlex.split(command)[1:]])

    def shell(self, command: str, argv: list[str], folder: Path | None = None) -> str:
        """Run a program, show it as `command`, and return what it printed."""
        began = time.monotonic()
        done = subprocess.run(argv, cwd=folder or self.folder, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True,
                              env={**os.environ, 'COLUMNS': str(_WIDTH)})
        seconds = time.monotonic() - began
        title, total = self.times[-1]
        self.times[-1] = (title, total + seconds)
        # Commands are printed in one piece, to be copied.
        shown = '\n'.join(line if line.startswith('  gravity_comp ') else wrapped(line, _WIDTH)
                          for line in _without_the_long(done.stdout))
        self.parts.append(f'```\n$ {command}\n{shown}\n```\n[{seconds:.1f} s]\n')
        return done.stdout

    def follow(self, printed: str, most: int = _FOLLOWED) -> None:
        """Run what was printed as the next step, and so on, until nothing is left to do."""
        for _ in range(most):
            commands = next_commands(printed)
            if not commands:
                return
            for command in commands:
                printed = self.run(command)

    def page(self) -> str:
        """Return the page, with the times of its parts."""
        rows = [f'| {title} | {seconds:.0f} s |' for title, seconds in self.times]
        total = sum(seconds for _, seconds in self.times)
        table = '\n'.join(['| part | commands |', '|---|---|', *rows,
                           f'| all commands | {total / 60:.1f} min |'])
        cores = len(os.sched_getaffinity(0))
        where = (f'On {cores} cores of a machine with other work, {_system()}, Python '
                 f'{platform.python_version()}:')
        return '\n'.join([HEAD, f'{where}\n\n{table}\n', *self.parts])

    def take_over(self, page: str) -> None:
        """Put the parts of an earlier page, with their times, where they are not made anew."""
        made = dict(self.times)
        split = _by_part('\n'.join(self.parts))
        earlier = _by_part(page.partition('\n## ')[2] and page[page.index('\n## ') + 1:])
        seconds = {title: float(number) for title, number in re.findall(
            r'^\| (.*) \| (\d+) s \|$', page, re.MULTILINE)}
        titles = [title for title in ORDER if title in made or title in earlier]
        self.times = [(title, made.get(title, seconds.get(title, 0.0))) for title in titles]
        self.parts = [split.get(title, earlier.get(title, '')) for title in titles]


def _by_part(text: str) -> dict[str, str]:
    """Return the parts of a page by title."""
    found = re.split(r'^(?=## )', text, flags=re.MULTILINE)
    return {part.split('\n')[0][3:]: part.rstrip('\n') + '\n' for part in found if part}


def next_commands(printed: str) -> list[str]:
    """Return the commands below the first `next step`, and those below it alone."""
    found: list[str] = []
    begun = False
    for line in printed.splitlines():
        if line.startswith('next step'):
            if found:
                break
            begun = True
        elif begun and line.startswith('  gravity_comp '):
            found.append(line.strip())
        elif found:
            break
    return found


def _without_the_long(printed: str) -> Iterator[str]:
    """Yield the lines of an output, equations and lists of what cannot be judged left out."""
    skipping = False
    for line in printed.rstrip().splitlines():
        line = line.rstrip()
        if skipping and (not line or not line.startswith(' ')):
            skipping = False
        if line.startswith('... ') or skipping:
            continue
        yield line
        if line.startswith(('torque in N·m', 'cannot be judged')):
            yield '  [...]'
            skipping = True


def _system() -> str:
    found = re.search(r'^PRETTY_NAME="(.*)"', Path('/etc/os-release').read_text(), re.MULTILINE)
    return found[1] if found else platform.system()


def set_up(session: Session) -> None:
    """Clone the project, run `make demo` there, and use the environment that this makes."""
    session.begin(SET_UP, 'On a machine with git, make and Python, in an empty folder:')
    session.shell('git clone <this repository> gravity_comp_ros',
                  ['git', 'clone', '-q', str(ROOT), 'gravity_comp_ros'])
    clone = session.folder / 'gravity_comp_ros'
    session.shell('cd gravity_comp_ros && make demo', ['make', '--no-print-directory', 'demo'],
                  clone)
    session.program = (str(clone / '.venv' / 'bin' / 'gravity_comp'),)


def walk_through(session: Session) -> None:
    """Run the commands of docs/walkthrough.md, without showing what they print once more."""
    session.begin(WALK, 'A simulated arm with hidden friction. What these commands '
                  'print is in\n[walkthrough.md](walkthrough.md).')
    lines = []
    for command in (command for _, some in STEPS for command in some):
        kept, before = len(session.parts), session.times[-1][1]
        session.run(command)
        del session.parts[kept:]
        lines.append(f'$ {command}\n[{session.times[-1][1] - before:.1f} s]')
    session.parts.append('```\n' + '\n'.join(lines) + '\n```\n')


def own_table(session: Session) -> None:
    """Bring a logger's table in, whose units are not given, and follow what is printed."""
    session.begin(OWN_TABLE, 'A log of an arm with three joints, as loggers write it: '
                  'milliseconds, degrees,\nsemicolons and decimal commas. Nothing of this is said '
                  'in the file. What cannot be is asked about.')
    head = write_table(session.folder / 'my_log.csv')
    session.say(f'```\n$ head -2 my_log.csv\n{head}\n```')
    command = 'gravity_comp convert my_log.csv -o my_log.mcap'
    printed = session.run(command)
    for question in ('--angle-unit deg', '--time-unit ms'):
        if not re.search(question, printed):
            raise SystemExit(f'{question} was not asked for: {printed}')
        command = command.replace(' -o', f' {question} -o')
        printed = session.run(command)
    session.follow(printed)


def own_bag(session: Session) -> None:
    """Follow what is printed for a recording with a gripper and joints by alphabet."""
    session.begin(OWN_BAG, 'A rosbag2 folder of an arm of three joints with a gripper, its joints '
                  'by alphabet and its\nefforts in mN·m. Its owner knows both.')
    write_bag(session.folder / 'my_bag')
    session.follow(session.run('gravity_comp info my_bag --effort-unit mNm --joints '
                               'base,shoulder,elbow'))


def real_recording(session: Session, recordings: Path, title: str, name: str,
                   prose: str) -> None:
    """Follow what is printed for one of the public recordings."""
    found = sorted(recordings.rglob(name))
    if not found:
        raise SystemExit(f'{name} is nowhere in {recordings}')
    shutil.copyfile(found[0], session.folder / name)
    for model in session.folder.glob('arm*.json'):
        model.unlink()
    session.begin(title, prose)
    if not name.endswith('.csv'):
        session.follow(session.run(f'gravity_comp info {name}'), _FOLLOWED_REAL)
        return
    command = f'gravity_comp convert {name} -o med7.mcap'
    session.run(command)
    session.say('The source says 100 Hz.')
    session.follow(session.run(command.replace(' -o', ' --rate 100 -o')), _FOLLOWED_TABLE)


def tests(session: Session, log: Path) -> None:
    """Show the end of what `make test` printed."""
    session.begin(TESTS, 'The second command, on the same machine, at another time. Its last line '
                  'has its time.')
    last = log.read_text().rstrip().splitlines()[-1]
    taken = re.search(r' in ([0-9.]+)s', last)
    if taken is None:
        raise SystemExit(f'{log}: the last line is not that of a run of tests: {last!r}')
    session.times[-1] = (TESTS, float(taken[1]))
    session.parts.append(f'```\n$ make test\n[...]\n{last}\n```\n')


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('recordings', type=Path)
    parser.add_argument('--set-up', action='store_true')
    parser.add_argument('--test-log', type=Path)
    parser.add_argument('--only', default='')
    args = parser.parse_args()
    os.environ['PYTHONPATH'] = str(ROOT)
    with tempfile.TemporaryDirectory() as folder:
        session = Session(Path(folder), (sys.executable, '-m', 'gravity_comp_ros.cli'))
        steps: dict[str, Callable[[], None]] = {
            WALK: lambda: walk_through(session), OWN_TABLE: lambda: own_table(session),
            OWN_BAG: lambda: own_bag(session)}
        for title, name, prose in REAL:
            steps[title] = partial(real_recording, session, args.recordings, title, name, prose)
        if args.set_up:
            os.environ.pop('PYTHONPATH')
            steps = {SET_UP: lambda: set_up(session), **steps}
        if args.test_log:
            steps[TESTS] = lambda: tests(session, args.test_log)
        for title, step in steps.items():
            if args.only.lower() in title.lower():
                step()
        if args.only:
            session.take_over(PAGE.read_text(encoding='utf-8'))
        PAGE.write_text(session.page(), encoding='utf-8')


if __name__ == '__main__':
    main()
