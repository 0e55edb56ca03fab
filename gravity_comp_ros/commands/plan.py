r"""
Plan the motion that resolves open findings.

For example:
  gravity_comp plan run1.mcap --model arm.json -o motion.yaml
  gravity_comp plan run1.mcap --model arm.json --settle coulomb_friction:elbow -o motion.yaml
  gravity_comp plan run1.mcap --model arm.json --widen 0.7 --urdf robot.urdf -o motion.yaml
  ros2 topic pub --once /joint_trajectory_controller/joint_trajectory \
      trajectory_msgs/msg/JointTrajectory "$(cat motion.yaml)"
  gravity_comp synth --motion motion.yaml -o new.mcap              simulate it
  gravity_comp diagnose run1.mcap new.mcap --model arm.json        the result

The motion begins and ends at rest at one recorded pose. It stays near recorded poses and moves one
or two joints at a time, or all joints if more have targets. Move the arm to the first point
before playing it. Obstacles and people are not checked: keep the space clear. With a description
and pinocchio, self-collisions of the arm are checked.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
import math
from pathlib import Path

from gravity_comp_ros.commands import arguments, next_step, reading, terminal
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.display import TextTable
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.planning.collision import arm_limits
from gravity_comp_ros.planning.expected import EXPECTED, MotionPlan
from gravity_comp_ros.planning.trajectory_files import ENDINGS, write_trajectory
from gravity_comp_ros.planning.workspace import PlanOptions
from gravity_comp_ros.printable import counted
import numpy as np

UNLIMITED = 'no description gives the position limits: check that no joint reaches an end ' \
    'stop, or name a description with --urdf'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `plan`."""
    arguments.add_model(parser, 'gravity model of the arm (chain or potential)')
    parser.add_argument('-o', '--output', metavar='MOTION', type=arguments.file_type(*ENDINGS),
                        required=True,
                        help=f'motion file to write ({", ".join(ENDINGS)})')
    parser.add_argument('--settle', metavar='EFFECT:JOINT,...',
                        help='effects to resolve; `gravity` for poses with a large uncertainty '
                        'of the model (default: effects that `diagnose` reports as ambiguous, '
                        'untestable or weak, and gravity where it is uncertain)')
    group = parser.add_argument_group('limits')
    arguments.add_urdf(group, 'robot description: position limits and collision geometry',
                       fixed=False)
    group.add_argument('--widen', metavar='RAD', type=arguments.positive,
                       help='extend the recorded range of every joint by this angle, in any pose '
                       'of the others, within the limits of the description if there is one; 7 '
                       'allows all of these limits; check that the arm has the space (default: '
                       'within 0.3 rad of recorded poses)')
    for name, unit, what in (('duration', 'S', 'maximum duration'),
                             ('max_speed', 'RAD/S', 'of every joint'),
                             ('max_acceleration', 'RAD/S²', 'of every joint'),
                             ('max_jerk', 'RAD/S³', 'of every joint')):
        group.add_argument('--' + name.replace('_', '-'), metavar=unit, type=arguments.positive,
                           default=getattr(PlanOptions, name),
                           help=f'{what} (default: %(default)s)')
    group.add_argument('--start', metavar='RAD,...', type=arguments.numbers,
                       help='start and end pose, one value for each joint of the model '
                       '(default: a recorded pose near the middle)')
    group = parser.add_argument_group('output')
    group.add_argument('--goal', action='store_true',
                       help='write YAML as the goal of a FollowJointTrajectory action')
    group.add_argument('--effort', action='store_true',
                       help="add the model's gravity torque as effort")
    arguments.add_reading(parser, joints=False)
    arguments.add_bags(parser)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> terminal.Answer:
    """Plan, write the motion, and show its expected results."""
    from gravity_comp_ros.planning.plan import plan  # imports SciPy
    model = load_model(args.model)
    args.joints = model.joints
    targets = None if args.settle is None else args.settle.split(',')
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
        *([TextTable(EXPECTED, [e.row() for e in planned.expectations], 'expected results')]
          if planned.expectations else []),
        *(f'  {each.sentence}' for each in planned.gravity), '',
        f'move the arm to {start} rad first', links,
        'obstacles are not checked: keep the space around the arm clear',
        f'written to {args.output}',
        *next_step.lines(f'play the motion on the arm (see `gravity_comp plan --help`), record it '
                         f'as {bags[-1]}, and diagnose all recordings together',
                         next_step.command('diagnose', args, bags=bags, model=args.model))]


def _advice(planned: MotionPlan, options: PlanOptions, model: GravityModel) -> list[str]:
    """Return options that may resolve effects the planned motion does not resolve."""
    names = ', '.join(each.target for each in planned.expectations if not each.is_likely)
    lines = []
    if names and options.low is None:
        lines.append(f'poses farther from the recorded ones may resolve {names}: --widen 0.7 '
                     f'extends the recorded range of every joint by 0.7 rad')
    if names and model.geometry is None:
        lines.append(f'a gravity model with known axes is collinear with fewer effects, which may '
                     f'resolve {names}: `gravity_comp fit --urdf FILE`, then plan with that model')
    return lines
