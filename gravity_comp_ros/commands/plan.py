"""`gravity_comp plan`: the motion that settles what recordings leave open."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api import results
from gravity_comp_ros.commands import next_step, reading, terminal
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.planning import Plan, plan, PlanOptions, Target
from gravity_comp_ros.planning.collision import collision_check
from gravity_comp_ros.planning.targets import named_targets
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.trajectory_files import write_trajectory
import numpy as np


def run(args: argparse.Namespace) -> int:
    """Plan, write the motion, and show what to expect of it."""
    model = load_model(args.model)
    args.joints = model.joints
    targets = _targets(args, model)
    if args.widen is not None and args.within == 'limits':
        raise OptionError('--widen and --within limits exclude each other: give one of them')
    with terminal.progress() as report:
        recording = reading.load(args, report, is_gated=False)
        q = recording.samples.joints(model.joints).q
        options = _options(args, model, q)
        check, links = collision_check(args.urdf, model.joints, q)
        found = plan(recording.samples, model, targets, options, progress=report, obstacles=check)
    trajectory = found.trajectory
    if args.effort:
        trajectory = replace(trajectory, effort=model.predict(trajectory.q))
    comments = [part.sentence for part in found.parts]
    write_trajectory(args.output, trajectory, comments, args.goal)
    if args.json != '-':
        _show(args, found, links)
    terminal.warn(*found.notes, *_advice(found, options, model))
    if args.json:
        terminal.emit_json({**found.to_json(), 'output': str(args.output), 'links': links,
                            'links_checked': check is not None,
                            'bags': [r.to_json() for r in recording.reports]}, args.json)
    return 0


def _targets(args: argparse.Namespace, model: GravityModel) -> list[Target] | None:
    if args.settle is None:
        return None
    return named_targets(args.settle.split(','), model.joints)


def _options(args: argparse.Namespace, model: GravityModel, q: FloatArray) -> PlanOptions:
    low = high = None
    reach = args.reach
    if args.within == 'limits':
        if args.urdf is None:
            raise OptionError('--within limits needs the limits: --urdf FILE')
        low, high = _described(args, model)
        reach = float('inf')
    elif args.widen is not None:
        low, high = q.min(axis=0) - args.widen, q.max(axis=0) + args.widen
        if args.urdf is not None:
            ends = _described(args, model)
            # The arm was at its recorded poses, whatever the description says.
            low = np.minimum(np.maximum(low, ends[0]), q.min(axis=0))
            high = np.maximum(np.minimum(high, ends[1]), q.max(axis=0))
        reach = float('inf')
    start = None if args.start is None else np.array(args.start)
    return PlanOptions(args.duration, args.max_speed, args.max_acceleration, args.max_jerk, reach,
                       low=low, high=high, start=start)


def _described(args: argparse.Namespace, model: GravityModel) -> tuple[FloatArray, FloatArray]:
    """Return the position limits of the description, with a margin of 2 % at either end."""
    from gravity_comp_ros.description.robot_tree import position_limits
    from gravity_comp_ros.description.urdf import read_text
    low, high = position_limits(read_text(args.urdf), model.joints, str(args.urdf))
    # A planned motion should not end at a stop.
    return low + 0.02 * (high - low), high - 0.02 * (high - low)


def _show(args: argparse.Namespace, found: Plan, links: str) -> None:
    length = f'{found.trajectory.duration:.1f} s'
    terminal.show(f'[bold]{counted(len(found.parts), "part")}, {length}[/bold]')
    for part in found.parts:
        terminal.show(f'  {terminal.safe(part.sentence)}')
    rows = [list(results.expected_row(each)) for each in found.expectations]
    terminal.show('', terminal.table('what to expect', results.EXPECTED, rows,
                                     results.EXPECTED[3:]))
    terminal.show(*(f'  {terminal.safe(each.sentence)}' for each in found.gravity))
    start = ', '.join(f'{value:.3f}' for value in found.trajectory.q[0])
    terminal.show('', terminal.safe(f'bring the arm to {start} rad first'),
                  terminal.safe(links),
                  'obstacles are not known here: keep the space around the arm clear',
                  terminal.safe(f'written to {args.output}'))
    # The recording of the motion has no name yet.
    bags = [*args.bags, Path(args.output).with_suffix('.mcap')]
    if bags[-1] == args.output:
        bags[-1] = bags[-1].with_stem(f'{bags[-1].stem}_played')
    next_step.show(f'play it on the arm (`gravity_comp plan --help` shows how), record it as '
                   f'{bags[-1]}, and diagnose all together',
                   next_step.command('diagnose', args, *_expected(args), bags=bags,
                                     model=args.model))


def _advice(found: Plan, options: PlanOptions, model: GravityModel) -> list[str]:
    """Return how to settle what the motion does not settle."""
    names = ', '.join(each.target.name for each in found.expectations if not each.is_likely)
    lines = []
    if names and not options.goes_beyond:
        lines.append(f'poses farther from the recorded ones may settle {names}: --widen 0.7 lets '
                     f'every joint leave its recorded range by 0.7 rad, --within limits --urdf '
                     f'FILE takes the limits of a description')
    if names and model.geometry is None:
        lines.append(f'gravity on known axes imitates less, which may settle {names} as well: '
                     f'`gravity_comp fit --urdf FILE`, then plan with that model')
    return lines


def _expected(args: argparse.Namespace) -> list[str]:
    return ['--plan', str(args.json)] if args.json and args.json != '-' else []
