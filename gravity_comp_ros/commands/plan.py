"""`gravity_comp plan`: plan a motion that resolves open findings."""

from __future__ import annotations

import argparse
from dataclasses import replace
import math
from pathlib import Path

from gravity_comp_ros.commands import next_step, reading, terminal
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.planning import MotionPlan, plan, PlanOptions
from gravity_comp_ros.planning.collision import arm_limits
from gravity_comp_ros.planning.expected import EXPECTED
from gravity_comp_ros.planning.questions import named_targets
from gravity_comp_ros.planning.trajectory_files import write_trajectory
from gravity_comp_ros.printable import counted
import numpy as np

UNLIMITED = 'no description gives the position limits: check that no joint reaches an end ' \
    'stop, or name a description with --urdf'


def run(args: argparse.Namespace) -> terminal.Answer:
    """Plan, write the motion, and show its expected results."""
    model = load_model(args.model)
    args.joints = model.joints
    targets = None if args.settle is None else named_targets(args.settle.split(','), model.joints)
    with terminal.progress() as report:
        recording = reading.load(args, report, is_gated=False)
        q = recording.samples.joints(model.joints).q
        limits = arm_limits(args.urdf, args.bags, model.joints, q)
        options = _options(args, limits.positions, q)
        planned = plan(recording.samples, model, targets, options, progress=report,
                       obstacles=limits.check)
    trajectory = planned.trajectory
    if args.effort:
        trajectory = replace(trajectory, effort=model.predict(trajectory.q))
    comments = [part.sentence for part in planned.parts]
    write_trajectory(args.output, trajectory, comments, args.goal)
    document = {**planned.to_json(), 'output': str(args.output), 'links': limits.note,
                'links_checked': limits.check is not None,
                'bags': [r.to_json() for r in recording.reports]}
    return terminal.Answer(document, _lines(args, planned, limits.note), [
        *planned.notes, *_advice(planned, options, model),
        *[UNLIMITED] * (args.widen is not None and limits.positions is None)])


def _options(args: argparse.Namespace, ends: tuple[FloatArray, FloatArray] | None,
             q: FloatArray) -> PlanOptions:
    """Return the options of the plan; recorded poses q (M, N) in rad are always allowed."""
    low = high = None
    if args.widen is not None:
        low, high = q.min(axis=0) - args.widen, q.max(axis=0) + args.widen
        if ends is not None:
            # Keep the planned motion away from end stops.
            margin = 0.02 * (ends[1] - ends[0])
            low = np.minimum(np.maximum(low, ends[0] + margin), q.min(axis=0))
            high = np.maximum(np.minimum(high, ends[1] - margin), q.max(axis=0))
    start = None if args.start is None else np.array(args.start)
    return PlanOptions(args.duration, args.max_speed, args.max_acceleration, args.max_jerk,
                       PlanOptions.reach if args.widen is None else math.inf, low=low, high=high,
                       start=start)


def _lines(args: argparse.Namespace, planned: MotionPlan, links: str) -> list[terminal.Line]:
    length = f'{planned.trajectory.duration:.1f} s'
    start = ', '.join(f'{value:.3f}' for value in planned.trajectory.q[0])
    # Suggest a name for the recording of the motion.
    bags = [*args.bags, Path(args.output).with_suffix('.mcap')]
    if bags[-1] == args.output:
        bags[-1] = bags[-1].with_stem(f'{bags[-1].stem}_played')
    return [
        terminal.styled('bold', f'{counted(len(planned.parts), "part")}, {length}'),
        *(f'  {part.sentence}' for part in planned.parts), '',
        terminal.table('expected results', EXPECTED, [e.row() for e in planned.expectations],
                       EXPECTED[3:]),
        *(f'  {each.sentence}' for each in planned.gravity), '',
        f'move the arm to {start} rad first', links,
        'obstacles are not checked: keep the space around the arm clear',
        f'written to {args.output}',
        *next_step.lines(f'play the motion on the arm (see `gravity_comp plan --help`), record it '
                         f'as {bags[-1]}, and diagnose all recordings together',
                         next_step.command('diagnose', args, bags=bags, model=args.model))]


def _advice(planned: MotionPlan, options: PlanOptions, model: GravityModel) -> list[str]:
    """Return options that may resolve effects the planned motion does not resolve."""
    names = ', '.join(each.target.name for each in planned.expectations if not each.is_likely)
    lines = []
    if names and options.low is None:
        lines.append(f'poses farther from the recorded ones may resolve {names}: --widen 0.7 '
                     f'extends the recorded range of every joint by 0.7 rad')
    if names and model.geometry is None:
        lines.append(f'a gravity model with known axes is collinear with fewer effects, which may '
                     f'resolve {names}: `gravity_comp fit --urdf FILE`, then plan with that model')
    return lines
