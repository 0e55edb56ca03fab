"""
Write docs/first_hour.md: the commands of a new user's first hour, with their output and times.

    python3 docs/make_first_hour.py RECORDINGS [--set-up] [--test-log FILE] [--only WORD]

RECORDINGS is a folder that contains the three public recordings. After the first command of each
part, the script runs only commands that were printed as the next step. With --set-up it starts
with a fresh clone and `make demo`, and uses that environment for all other parts. FILE is the
output of `make test`. With --only, only parts with this word in their title are written; the
others are kept.
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
# Maximum number of next steps in each part, fewer where each takes long.
_FOLLOWED, _FOLLOWED_REAL, _FOLLOWED_TABLE = 6, 4, 3

HEAD = """\
# The first hour

`python3 docs/make_first_hour.py` writes this page: it runs every command and copies its output,
including warnings and errors. Long lines are wrapped. `[...]` marks omitted lines: equations,
effects that are not identifiable, and progress. After the first command of each part, every
command is a next step printed by the command before it. Parts with real recordings end after a few
steps. The time in brackets is the duration of the command.
"""
REAL = (
    ('A recording of a real UR10', 'ur10_exciting_trajectory.db3',
     'From unisa-acg/inverse-dynamics-solver (BSD-3): 27 s of an identification motion,\n'
     'at up to 2.2 rad/s. The effort is motor current times gains.'),
    ('A recording of a real Franka Panda', 'panda_exciting_trajectory.db3',
     'From the same project: 24 s at 30 Hz, with joint torque sensors.'),
    ('A table of a real KUKA LBR Med 7', 'measurements.csv',
     'From lbr-stack/dynamic_parameter_identification (MIT): 16 s at 100 Hz, without times; the\n'
     'arm is at rest for the first 6.5 s. The torques have the opposite sign, which the table\n'
     'does not document.'))


SET_UP, WALK, TESTS = 'Setting up', 'The walk-through', 'All tests'
OWN_TABLE, OWN_BAG = 'A table of your own', 'A bag of your own'
ORDER = (SET_UP, WALK, OWN_TABLE, OWN_BAG, *(title for title, _, _ in REAL), TESTS)


@dataclass
class Session:
    """Commands run one after another in a folder; `parts` are the parts of the page."""

    folder: Path
    program: tuple[str, ...]
    parts: list[str] = field(default_factory=list)
    times: list[tuple[str, float]] = field(default_factory=list)

    def begin(self, title: str, prose: str) -> None:
        """Start a part of the page."""
        self.parts.append(f'## {title}\n\n{prose}\n')
        self.times.append((title, 0.0))

    def say(self, prose: str) -> None:
        """Add text between commands."""
        self.parts.append(f'{prose}\n')

    def run(self, command: str) -> str:
        """Run a command of this package, show it, and return its output."""
        return self.shell(command, [*self.program, *shlex.split(command)[1:]])

    def shell(self, command: str, argv: list[str], folder: Path | None = None) -> str:
        """Run a program, show it as `command`, and return its output."""
        began = time.monotonic()
        done = subprocess.run(argv, cwd=folder or self.folder, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True,
                              env={**os.environ, 'COLUMNS': str(_WIDTH)})
        seconds = time.monotonic() - began
        title, total = self.times[-1]
        self.times[-1] = (title, total + seconds)
        # Commands are not wrapped, so that they can be copied.
        printed = '\n'.join(line if line.startswith('  gravity_comp ') else wrapped(line, _WIDTH)
                            for line in _shortened(done.stdout))
        self.parts.append(f'```\n$ {command}\n{printed}\n```\n[{seconds:.1f} s]\n')
        return done.stdout

    def follow(self, printed: str, max_steps: int = _FOLLOWED) -> None:
        """Run the printed next steps, until there is none or the maximum is reached."""
        for _ in range(max_steps):
            commands = next_commands(printed)
            if not commands:
                return
            for command in commands:
                printed = self.run(command)

    def page(self) -> str:
        """Return the page, with a table of the times of its parts."""
        rows = [f'| {title} | {seconds:.0f} s |' for title, seconds in self.times]
        total = sum(seconds for _, seconds in self.times)
        table = '\n'.join(['| part | commands |', '|---|---|', *rows,
                           f'| all commands | {total / 60:.1f} min |'])
        cores = len(os.sched_getaffinity(0))
        machine = (f'On {cores} cores of a machine with other load, {_system()}, Python '
                   f'{platform.python_version()}:')
        return '\n'.join([HEAD, f'{machine}\n\n{table}\n', *self.parts])

    def keep_other_parts(self, page: str) -> None:
        """Insert the parts of an earlier page, with their times, that were not run again."""
        times = dict(self.times)
        split = _by_part('\n'.join(self.parts))
        earlier = _by_part(page.partition('\n## ')[2] and page[page.index('\n## ') + 1:])
        seconds = {title: float(number) for title, number in re.findall(
            r'^\| (.*) \| (\d+) s \|$', page, re.MULTILINE)}
        titles = [title for title in ORDER if title in times or title in earlier]
        self.times = [(title, times.get(title, seconds.get(title, 0.0))) for title in titles]
        self.parts = [split.get(title, earlier.get(title, '')) for title in titles]


def _by_part(text: str) -> dict[str, str]:
    """Return the parts of a page by title."""
    sections = re.split(r'^(?=## )', text, flags=re.MULTILINE)
    return {part.split('\n')[0][3:]: part.rstrip('\n') + '\n' for part in sections if part}


def next_commands(printed: str) -> list[str]:
    """Return the commands of the first `next step`."""
    commands: list[str] = []
    begun = False
    for line in printed.splitlines():
        if line.startswith('next step'):
            if commands:
                break
            begun = True
        elif begun and line.startswith('  gravity_comp '):
            commands.append(line.strip())
        elif commands:
            break
    return commands


def _shortened(printed: str) -> Iterator[str]:
    """Yield the lines of an output without equations and lists of untestable effects."""
    skipping = False
    for line in printed.rstrip().splitlines():
        line = line.rstrip()
        if skipping and (not line or not line.startswith(' ')):
            skipping = False
        if line.startswith('... ') or skipping:
            continue
        yield line
        if line.startswith(('torque in N·m', 'not identifiable')):
            yield '  [...]'
            skipping = True


def _system() -> str:
    match = re.search(r'^PRETTY_NAME="(.*)"', Path('/etc/os-release').read_text(), re.MULTILINE)
    return match[1] if match else platform.system()


def set_up(session: Session) -> None:
    """Clone the project, run `make demo`, and use the resulting environment."""
    session.begin(SET_UP, 'On a machine with git, make and Python, in an empty folder:')
    session.shell('git clone <this repository> gravity_comp_ros',
                  ['git', 'clone', '-q', str(ROOT), 'gravity_comp_ros'])
    clone = session.folder / 'gravity_comp_ros'
    session.shell('cd gravity_comp_ros && make demo', ['make', '--no-print-directory', 'demo'],
                  clone)
    session.program = (str(clone / '.venv' / 'bin' / 'gravity_comp'),)


def walk_through(session: Session) -> None:
    """Run the commands of docs/walkthrough.md without showing their output again."""
    session.begin(WALK, 'A simulated arm with hidden friction. [walkthrough.md](walkthrough.md) '
                  'shows the\noutput of these commands.')
    lines = []
    for command in (command for _, some in STEPS for command in some):
        kept, before = len(session.parts), session.times[-1][1]
        session.run(command)
        del session.parts[kept:]
        lines.append(f'$ {command}\n[{session.times[-1][1] - before:.1f} s]')
    session.parts.append('```\n' + '\n'.join(lines) + '\n```\n')


def own_table(session: Session) -> None:
    """Convert a logger's table without units, and follow the printed next steps."""
    session.begin(OWN_TABLE, 'A log of an arm with three joints in a common format: '
                  'milliseconds, degrees,\nsemicolons and decimal commas. The file documents none '
                  'of this. `convert` requires the units\nthat the values contradict.')
    head = write_table(session.folder / 'my_log.csv')
    session.say(f'```\n$ head -2 my_log.csv\n{head}\n```')
    command = 'gravity_comp convert my_log.csv -o my_log.mcap'
    printed = session.run(command)
    for option in ('--position-unit deg', '--time-unit ms'):
        if not re.search(option, printed):
            raise SystemExit(f'{option} was not requested: {printed}')
        command = command.replace(' -o', f' {option} -o')
        printed = session.run(command)
    session.follow(printed)


def own_bag(session: Session) -> None:
    """Follow the printed next steps for a bag with a gripper and sorted joints."""
    session.begin(OWN_BAG, 'A rosbag2 folder of an arm with three joints and a gripper, with '
                  'joints in alphabetical order\nand efforts in mN·m.')
    write_bag(session.folder / 'my_bag')
    session.follow(session.run('gravity_comp info my_bag --effort-unit mNm --joints '
                               'base,shoulder,elbow'))


def real_recording(session: Session, recordings: Path, title: str, name: str,
                   prose: str) -> None:
    """Follow the printed next steps for one of the public recordings."""
    paths = sorted(recordings.rglob(name))
    if not paths:
        raise SystemExit(f'{name} is not in {recordings}')
    shutil.copyfile(paths[0], session.folder / name)
    for model in session.folder.glob('arm*.json'):
        model.unlink()
    session.begin(title, prose)
    if not name.endswith('.csv'):
        session.follow(session.run(f'gravity_comp info {name}'), _FOLLOWED_REAL)
        return
    command = f'gravity_comp convert {name} -o med7.mcap'
    session.run(command)
    session.say('The source documents 100 Hz.')
    session.follow(session.run(command.replace(' -o', ' --rate 100 -o')), _FOLLOWED_TABLE)


def tests(session: Session, log: Path) -> None:
    """Show the last line of the output of `make test`."""
    session.begin(TESTS, 'All tests on the same machine, run separately. The last line includes '
                  'the time.')
    last = log.read_text().rstrip().splitlines()[-1]
    duration = re.search(r' in ([0-9.]+)s', last)
    if duration is None:
        raise SystemExit(f'{log}: the last line is not the result of a test run: {last!r}')
    session.times[-1] = (TESTS, float(duration[1]))
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
            session.keep_other_parts(PAGE.read_text(encoding='utf-8'))
        PAGE.write_text(session.page(), encoding='utf-8')


if __name__ == '__main__':
    main()
