"""`gravity_comp fleet`: fit or diagnose every robot of a folder."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gravity_comp_ros.api.axes import ArmOptions
from gravity_comp_ros.commands import arguments, terminal
from gravity_comp_ros.diagnosis.findings import Verdict
from gravity_comp_ros.effects.request import known_effect
from gravity_comp_ros.errors import BagError, OptionError
from gravity_comp_ros.fleet.run import (
    ClusterOptions, find_robots, FleetOptions, Outcome, run_fleet)
from gravity_comp_ros.printable import counted


def run(args: argparse.Namespace) -> terminal.Answer:
    """Fit or diagnose every robot and report the result of each."""
    _check_usage(args)
    cluster = ClusterOptions(args.workers, args.scheduler)
    robots = find_robots(args.folder)
    _check_json([robot.name for robot in robots], args)
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


def _check_json(robots: Sequence[str], args: argparse.Namespace) -> None:
    """
    Refuse a summary file that would replace a robot's model or findings.

    :raises OptionError: if --json names a file of a robot.
    """
    if not args.json or args.json == '-':
        return
    target = Path(args.json).resolve()
    folders = [folder.resolve() for folder in (args.output, args.models) if folder]
    names = {f'{robot}{end}' for robot in robots for end in ('.json', '.diagnosis.json')}
    if target.parent in folders and target.name in names:
        raise OptionError(f'--json {args.json} is the result file of a robot; '
                          f'name another file')


def _lines(what: str, outcome: Outcome) -> list[terminal.Line]:
    columns, rows = ['robot', 'findings', 'file'], []
    if what == 'fit':
        columns = ['robot', 'bags', 'samples', 'worst RMSE N·m', 'model']
    for name, entry in sorted(outcome.robots.items()):
        rows.append([name, str(entry['bags']), str(entry['samples']),
                     f'{max(entry["rmse"].values()):.4f}', entry['model']] if what == 'fit'
                    else [name, _findings(entry['findings']), entry['diagnosis']])
    return [terminal.table(f'{what}: {counted(len(rows), "robot")}', columns, rows,
                           left=('findings', 'model', 'file')),
            f'omitted: {counted(len(outcome.failed_bags), "bag")} and '
            f'{counted(len(outcome.failed_robots), "robot")}; '
            f'{counted(outcome.resumed, "result")} from an earlier run']


def _findings(findings: Sequence[Mapping[str, Any]]) -> str:
    items = [f'{f["effect"] or "unexplained"}:{f["joint"] or "arm"} ({f["verdict"]})'
             for f in findings
             if f['verdict'] in (Verdict.ESTABLISHED, Verdict.LIKELY, Verdict.AMBIGUOUS)]
    return ', '.join(items) or 'nothing missing'
