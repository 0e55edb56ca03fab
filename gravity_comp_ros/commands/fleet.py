"""
Fit or diagnose every robot of a folder, locally or on a Dask cluster.

For example:
  gravity_comp fleet fit recordings/ -o models/          recordings/ROBOT/*.mcap
  gravity_comp fleet diagnose recordings/ --models models/ -o findings/
  gravity_comp fleet fit recordings/ -o models/ --workers 8
  gravity_comp fleet fit /nfs/recordings -o models/ --scheduler tls://10.0.0.5:8786

Each subfolder contains the bags of one robot. A bag or robot that fails is reported and omitted.
After an interruption the same command resumes; after new bags it processes only what changed.
A Dask cluster requires the bags under the same path and this package of the same version. A
program that reaches a scheduler tcp://... can run code on its workers and here; docs/fleet.md
describes TLS.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
import os
from pathlib import Path
from typing import Any, TYPE_CHECKING

from gravity_comp_ros.api.axes import ArmOptions
from gravity_comp_ros.commands import arguments, terminal
from gravity_comp_ros.diagnosis.findings import Verdict
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.effects.registry import known_effect
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.models.gravity_model import CHOICES
from gravity_comp_ros.printable import counted

if TYPE_CHECKING:
    from gravity_comp_ros.fleet.run import Outcome


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fleet`."""
    parser.add_argument('what', choices=('fit', 'diagnose'), help='operation for each robot')
    parser.add_argument('folder', metavar='FOLDER', type=Path,
                        help='folder with one subfolder of bags for each robot')
    parser.add_argument('-o', '--output', metavar='FOLDER', type=Path, required=True,
                        help='output folder: ROBOT.json, ROBOT.diagnosis.json')
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--workers', metavar='N', type=arguments.count, default=os.cpu_count() or 1,
                       help='processes on this machine (default: one per core)')
    where.add_argument('--scheduler', metavar='ADDRESS',
                       help='Dask scheduler, e.g. tls://10.0.0.5:8786')
    parser.add_argument('--formulation', choices=CHOICES,
                        default=CHOICES[0],
                        help='formulation of `fit` (default: %(default)s)')
    parser.add_argument('--models', metavar='FOLDER', type=Path,
                        help='`diagnose` uses FOLDER/ROBOT.json (default: models are fitted)')
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list,
                        help='`diagnose` tests these effects only (default: all)')
    arguments.add_gate(parser, 'slow-motion gate of `fit`')
    # ROBOT.diagnosis.json is none of the models.
    parser.set_defaults(output_is_folder=True, in_place='models')
    arguments.add_reading(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> terminal.Answer:
    """Fit or diagnose every robot and report the result of each."""
    # Dask takes 0.3 s to import.
    from gravity_comp_ros.fleet.run import ClusterOptions, find_robots, FleetOptions, run_fleet
    _check_usage(args)
    cluster = ClusterOptions(args.workers, args.scheduler)
    robots = find_robots(args.folder)
    learning = ArmOptions(args.formulation, ordered=args.joints is not None)
    options = FleetOptions(args.what, arguments.read_options(args), arguments.gate(args), learning,
                           args.models, args.effects)
    terminal.warn(*([cluster.warning] if cluster.warning else []))
    with terminal.progress() as report:
        outcome = run_fleet(robots, args.output, options, cluster, report)
    answer = terminal.Answer(vars(outcome), _lines(args.what, outcome), [
        f'omitted: {name}: {reason}' for name, reason in (
            *outcome.failed_bags.items(), *outcome.failed_robots.items())])
    if not outcome.robots:
        answer.give(args.json)
        raise BagError(f'no robot of {args.folder} has a result')
    return answer


def _check_usage(args: argparse.Namespace) -> None:
    """Refuse options of the other step, and unknown effects."""
    diagnoses = args.what == 'diagnose'
    other = ('max_speed', 'rate', 'all_samples') if diagnoses else ('models', 'effects')
    given = [f'--{name.replace("_", "-")}' for name in other if getattr(args, name)]
    if given:
        args.parser.error(f'{", ".join(given)}: `diagnose` uses all samples' if diagnoses
                          else f'{", ".join(given)}: `fit` fits gravity alone')
    for name in args.effects or ():
        known_effect(name)


def _lines(what: str, outcome: Outcome) -> list[terminal.Line]:
    columns, rows = ['robot', 'findings', 'file'], []
    if what == 'fit':
        columns = ['robot', 'bags', 'samples', 'worst RMSE N·m', 'model']
    for name, entry in sorted(outcome.robots.items()):
        rows.append([name, str(entry['bags']), str(entry['samples']),
                     f'{max(entry["rmse"].values()):.4f}', entry['model']] if what == 'fit'
                    else [name, _findings(entry['findings']), entry['diagnosis']])
    return [TextTable(columns, rows, f'{what}: {counted(len(rows), "robot")}'),
            f'omitted: {counted(len(outcome.failed_bags), "bag")} and '
            f'{counted(len(outcome.failed_robots), "robot")}; '
            f'{counted(outcome.resumed, "result")} from an earlier run']


def _findings(findings: Sequence[Mapping[str, Any]]) -> str:
    items = [f'{f["effect"] or "unexplained"}:{f["joint"] or "arm"} ({f["verdict"]})'
             for f in findings
             if f['verdict'] in (Verdict.ESTABLISHED, Verdict.LIKELY, Verdict.AMBIGUOUS)]
    return ', '.join(items) or 'nothing missing'
