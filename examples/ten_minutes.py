#!/usr/bin/env python3
"""
From nothing to a checked model of one arm, in three recordings of two minutes.

    python3 examples/ten_minutes.py NAME first.mcap
    python3 examples/ten_minutes.py NAME first.mcap planned.mcap --judge second.mcap
    python3 examples/ten_minutes.py NAME --simulate robot.urdf

The first call fits a model and plans the motion that determines gravity and the friction of every
joint. The second one fits both recordings, adds what is missing, judges the model on a recording
that it has not seen, and files everything in config/arms/NAME/DATE of this package, or in another
--folder; both are created. If that folder has an earlier model of NAME, what drifted since then is
shown. --simulate does both with a simulated arm, and once more with larger friction.
docs/ten_minutes.md explains each step. Other options are passed to the verbs that read recordings,
such as --effort-scale elbow=0.12.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from importlib.util import find_spec
import json
from pathlib import Path
import shlex
import shutil
import sys
import tempfile

from gravity_comp_ros.cli import main as gravity_comp

FOLDER = Path(__file__).resolve().parents[1] / 'config' / 'arms'
MODEL = 'arm.json'
# Recordings of --simulate: slow, at 20 Hz, with friction on the second joint.
SLOW = ('--motion', 'multisine', '--max-speed', '0.12', '--rate', '20', '--duration', '120')


class Failed(Exception):
    """A verb failed; the argument is its exit status."""


def call(*words: str | Path) -> None:
    """Show and run a verb of gravity_comp."""
    command = [str(word) for word in words]
    print(f'\n$ gravity_comp {shlex.join(command)}', flush=True)
    status = gravity_comp(command)
    if status:
        raise Failed(status)


@dataclass(frozen=True)
class Arm:
    """One physical arm: its folder, and options of all verbs that read its recordings."""

    folder: Path
    urdf: Path | None
    options: tuple[str, ...] = ()

    def models(self) -> list[Path]:
        """Return the filed models, the earliest first."""
        return sorted(self.folder.glob(f'*/{MODEL}'), key=lambda path: path.parent.name)

    def plan(self, first: Path, duration: str = '120') -> Path:
        """Fit the first recording, and plan the next motion; return its file."""
        motion, model = self.folder / 'motion.yaml', self.folder / 'first.json'
        with self._made(self.folder):
            call('info', first, *self.options)
            self._fit([first], model)
            call('plan', first, *self.options, '--model', model, '--settle',
                 'gravity,coulomb_friction', '--duration', duration, '-o', motion)
        print(f'\nPlay {motion} on the arm and record it, then record a second motion of your own')
        return motion

    def file(self, bags: Sequence[Path], second: Path) -> Path:
        """Fit, add, judge on the second recording, and file; return the new folder."""
        earlier, target = self.models(), self._new_folder()
        model, findings = target / MODEL, target / 'findings.json'
        with self._made(target):
            self._fit(bags, model)
            call('diagnose', *bags, *self.options, '--model', model, '--json', findings)
            missing = targets(json.loads(findings.read_text()))
            if missing:
                call('add', ','.join(missing), *bags, *self.options, '--model', model)
            # Plots need Bokeh, numbers do not.
            page = ('--html', target / 'report.html') if find_spec('bokeh') else ()
            previous = ('--previous', earlier[-1]) if earlier else ()
            call('compare', second, *self.options, '--model', model, *previous,
                 '--json', target / 'judged.json', *page)
        print(f'\nfiled in {target}: {", ".join(sorted(x.name for x in target.iterdir()))}')
        return target

    @contextmanager
    def _made(self, folder: Path) -> Iterator[None]:
        """Make a folder; remove it, and that of the arm, if a step fails and nothing is left."""
        is_new = not folder.exists()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            print(f'cannot make the folder {folder}: {problem.strerror}', file=sys.stderr)
            raise Failed(1) from problem
        try:
            yield
        except BaseException:
            if is_new:
                shutil.rmtree(folder)
            if self.folder.exists() and not any(self.folder.iterdir()):
                self.folder.rmdir()
            raise

    def _fit(self, bags: Sequence[Path], model: Path) -> None:
        urdf = () if self.urdf is None else ('--urdf', self.urdf)
        call('fit', *bags, *self.options, *urdf, '-o', model)

    def _new_folder(self) -> Path:
        """Return the folder of today; a later one of the same day has a number."""
        today = date.today().isoformat()
        names = [today, *(f'{today}-{number}' for number in range(2, 100))]
        return next(self.folder / name for name in names if not (self.folder / name).exists())


def targets(diagnosis: dict) -> list[str]:
    """Return the effects to add, as `NAME:JOINT` or `NAME`, those that `diagnose` suggests."""
    return list(dict.fromkeys(name for one in diagnosis['findings'] for name in one['to_add']))


def simulated(arm: Arm, urdf: Path, folder: Path, friction: float, visit: int) -> Path:
    """Record a simulated arm with friction on its second joint as the page says; file it."""
    def synth(name: str, *motion: str | Path) -> Path:
        path = folder / f'{name}_{visit}.mcap'
        call('synth', '--arm', urdf, *motion, '--noise', '0.05', '--hidden',
             f'coulomb_friction:2={friction}', '-o', path)
        return path

    first = synth('first', *SLOW, '--seed', str(10 * visit))
    planned = synth('planned', '--motion', arm.plan(first, '60'), '--seed', str(10 * visit + 1))
    second = synth('second', *SLOW, '--seed', str(10 * visit + 2))
    return arm.file([first, planned], second)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the steps that the given recordings allow."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('name', help='name of the arm, such as its serial number')
    parser.add_argument('bags', nargs='*', type=Path, help='recordings to fit')
    parser.add_argument('--judge', type=Path, help='recording of a second motion')
    parser.add_argument('--urdf', type=Path, help='robot description of the arm')
    parser.add_argument('--folder', type=Path, default=FOLDER, help='default: config/arms')
    parser.add_argument('--simulate', metavar='URDF', type=Path, help='simulated arm')
    args, options = parser.parse_known_args(argv)
    if Path(args.name).name != args.name or args.name.startswith('.') or args.name.endswith(
            '.mcap'):
        parser.error(f'{args.name!r} is no name of an arm')
    if (args.simulate is None) == (not args.bags):
        parser.error('name recordings of the arm, or --simulate')
    arm = Arm(args.folder / args.name, args.urdf, tuple(options))
    for path in (*args.bags, *filter(None, (args.judge, args.urdf, args.simulate))):
        if not path.exists():
            print(f'no such file: {path}', file=sys.stderr)
            return 1
    try:
        if args.simulate is not None:
            with tempfile.TemporaryDirectory() as scratch:
                for visit, friction in enumerate((0.8, 1.2), start=1):
                    simulated(arm, args.simulate, Path(scratch), friction, visit)
        elif args.judge is None:
            arm.plan(args.bags[-1])
        else:
            arm.file(args.bags, args.judge)
    except Failed as failed:
        return int(failed.args[0])
    return 0


if __name__ == '__main__':
    sys.exit(main())
