"""`gravity_comp fleet`: fit or diagnose every robot of a folder."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
import os
from pathlib import Path

from gravity_comp_ros.commands import arguments, terminal
from gravity_comp_ros.commands.verbs import VERBS
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.errors import BagError, OptionError
from gravity_comp_ros.estimation.fit import CHOICES, FitOptions
from gravity_comp_ros.fleet.engine import Engine
from gravity_comp_ros.fleet.folder import find_robots
from gravity_comp_ros.fleet.run import FleetRun, Outcome
from gravity_comp_ros.printable import counted

VERB = 'fleet'
HELP = VERBS[VERB]
EPILOG = """\
examples:
  gravity_comp fleet fit recordings/ -o models/          recordings/ROBOT/*.mcap
  gravity_comp fleet diagnose recordings/ --models models/ -o findings/
  gravity_comp fleet fit recordings/ -o models/ --workers 8
  gravity_comp fleet fit /nfs/recordings -o models/ --scheduler tcp://10.0.0.5:8786

Each subfolder is a robot and has its bags. A bag or robot that fails is reported and left out.
Interrupted, the same command goes on where it stopped; with more bags, only what is new is done.
A Dask cluster must see the bags under the same path, and have this package installed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fleet`."""
    parser.add_argument('what', choices=('fit', 'diagnose'), help='what to do with each robot')
    parser.add_argument('folder', metavar='FOLDER', type=Path,
                        help='a folder for each robot, the bags of that robot in it')
    parser.add_argument('-o', '--output', metavar='FOLDER', type=Path, required=True,
                        help='where results go: ROBOT.json, ROBOT.diagnosis.json')
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--workers', metavar='N', type=arguments.count, default=os.cpu_count() or 1,
                       help='processes on this machine (default: one a core)')
    where.add_argument('--scheduler', metavar='ADDRESS', default=None,
                       help='a Dask scheduler, e.g. tcp://10.0.0.5:8786')
    parser.add_argument('--formulation', choices=CHOICES, default=FitOptions().formulation,
                        help='what `fit` fits (default: %(default)s)')
    parser.add_argument('--models', metavar='FOLDER', type=Path, default=None,
                        help='`diagnose` judges FOLDER/ROBOT.json (default: models are fitted)')
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list, default=None,
                        help='`diagnose` looks for these effects only (default: all)')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
    parser.set_defaults(output_is_folder=True)


def run(args: argparse.Namespace) -> int:
    """Do it, and tell what became of every robot; 1 if none has a result."""
    if args.all_samples:
        raise OptionError('fleet: --all-samples does not go with many bags; raise --max-speed '
                          'and --rate instead')
    for name in args.effects or ():
        known_effect(name)
    robots = find_robots(args.folder)
    _check_json([robot.name for robot in robots], args)
    with terminal.progress() as report:
        fleet = FleetRun(robots, args.output, Engine(args.workers, args.scheduler),
                         arguments.read_options(args), arguments.gate_options(args), report)
        outcome = (fleet.fit(FitOptions(args.formulation)) if args.what == 'fit'
                   else fleet.diagnose(args.models, args.effects))
    for name, reason in (*outcome.failed_bags.items(), *outcome.failed_robots.items()):
        terminal.warn(f'left out: {name}: {reason}')
    if args.json != '-':
        _show(args.what, outcome)
    if args.json:
        terminal.emit_json(asdict(outcome), args.json)
    if not outcome.robots:
        raise BagError(f'no robot of {args.folder} has a result')
    return 0


def _check_json(robots: Sequence[str], args: argparse.Namespace) -> None:
    """
    Refuse a summary that would replace a robot's model or findings.

    :raises OptionError: if --json names a file of a robot.
    """
    if not args.json or args.json == '-':
        return
    target = Path(args.json).resolve()
    folders = [folder.resolve() for folder in (args.output, args.models) if folder]
    names = {f'{robot}{end}' for robot in robots for end in ('.json', '.diagnosis.json')}
    if target.parent in folders and target.name in names:
        raise OptionError(f'--json {args.json} is the file of a robot: it would be overwritten; '
                          f'name another file')


def _show(what: str, outcome: Outcome) -> None:
    columns, rows = ['robot', 'findings', 'file'], []
    if what == 'fit':
        columns = ['robot', 'bags', 'samples', 'worst RMSE N·m', 'model']
    for name, done in sorted(outcome.robots.items()):
        rows.append([name, str(done['bags']), str(done['samples']),
                     f'{max(done["rmse"].values()):.4f}', done['model']] if what == 'fit'
                    else [name, _findings(done['findings']), done['diagnosis']])
    terminal.show(terminal.table(f'{what}: {counted(len(rows), "robot")}', columns, rows,
                                 left=('findings', 'model', 'file')))
    terminal.show(f'left out: {counted(len(outcome.failed_bags), "bag")} and '
                  f'{counted(len(outcome.failed_robots), "robot")}; '
                  f'{counted(outcome.resumed, "result")} of an earlier run')


def _findings(findings: list[dict]) -> str:
    told = [f'{f["effect"] or "unexplained"}:{f["joint"] or "arm"} ({f["verdict"]})'
            for f in findings if f['verdict'] in ('established', 'likely', 'ambiguous')]
    return ', '.join(told) or 'nothing missing'
