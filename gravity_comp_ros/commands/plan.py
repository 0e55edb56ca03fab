"""`gravity_comp plan`: the motion that settles what recordings leave open."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from gravity_comp_ros.api.provenance import bag_json
from gravity_comp_ros.commands import arguments, reading, terminal
from gravity_comp_ros.commands.verbs import VERBS
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.planning import Expectation, Plan, plan, PlanOptions, Target
from gravity_comp_ros.recordings.trajectory_files import ENDINGS, write_trajectory
import numpy as np

VERB = 'plan'
HELP = VERBS[VERB]
EPILOG = """\
examples:
  gravity_comp plan run1.mcap --model arm.json -o motion.yaml
  gravity_comp plan run1.mcap --model arm.json --settle coulomb_friction:elbow -o motion.csv
  gravity_comp plan run1.mcap --model arm.json --within limits --urdf robot.urdf -o motion.yaml
  ros2 topic pub --once /joint_trajectory_controller/joint_trajectory \\
      trajectory_msgs/msg/JointTrajectory "$(cat motion.yaml)"
  gravity_comp synth --motion motion.yaml -o new.mcap              plays it on a simulated arm
  gravity_comp diagnose run1.mcap new.mcap --model arm.json        what is settled now

The motion begins and ends at rest at one recorded pose, and moves one or two joints at a time
within recorded poses. Bring the arm to the first point before it is played. Nothing here sees
obstacles, people or the arm's own links: keep clear of them.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `plan`."""
    arguments.add_bags(parser)
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='the gravity model of the arm (chain or potential)')
    parser.add_argument('-o', '--output', metavar='MOTION', type=_motion_file, required=True,
                        help=f'write the motion here ({", ".join(ENDINGS)})')
    parser.add_argument('--settle', metavar='EFFECT:JOINT,...', default=None,
                        help='settle these (default: what `diagnose` finds ambiguous, untestable '
                        'or weak)')
    usual = PlanOptions()
    group = parser.add_argument_group('limits')
    group.add_argument('--within', choices=('recorded', 'limits'), default='recorded',
                       help='stay near recorded poses, or within the position limits of --urdf '
                       '(default: recorded)')
    group.add_argument('--urdf', metavar='FILE.urdf', type=Path, default=None,
                       help='the robot description, for --within limits')
    group.add_argument('--reach', metavar='RAD', type=arguments.positive, default=usual.reach,
                       help='how far each joint may be from a recorded pose '
                       '(default: %(default)s)')
    for name, unit, what in (('duration', 'S', 'longest motion'),
                             ('max_speed', 'RAD/S', 'of every joint'),
                             ('max_acceleration', 'RAD/S²', 'of every joint'),
                             ('max_jerk', 'RAD/S³', 'of every joint')):
        group.add_argument('--' + name.replace('_', '-'), metavar=unit, type=arguments.positive,
                           default=getattr(usual, name), help=f'{what} (default: %(default)s)')
    group.add_argument('--start', metavar='RAD,...', type=_pose, default=None,
                       help='begin and end at this pose, a value for each joint of the model '
                       '(default: a recorded pose near the middle)')
    group = parser.add_argument_group('output')
    group.add_argument('--goal', action='store_true',
                       help='write YAML as the goal of a FollowJointTrajectory action')
    group.add_argument('--effort', action='store_true',
                       help="add the model's gravity torque as effort")
    arguments.add_reading(parser, joints=False)
    arguments.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Plan, write the motion, and show what to expect of it."""
    model = load_model(args.model)
    args.joints = model.joints
    targets = _targets(args, model)
    with terminal.progress() as report:
        recording = reading.load_all(args, report)
        found = plan(recording.samples, model, targets, _options(args, model), progress=report)
    trajectory = found.trajectory
    if args.effort:
        trajectory = replace(trajectory, effort=model.predict(trajectory.q))
    comments = [part.sentence for part in found.parts]
    write_trajectory(args.output, trajectory, comments, args.goal)
    if args.json != '-':
        _show(args, found)
    for note in found.notes:
        terminal.warn(note)
    if args.json:
        terminal.emit_json({**_to_json(found), 'output': str(args.output),
                            'bags': [bag_json(r) for r in recording.reports]}, args.json)
    return 0


def _targets(args: argparse.Namespace, model: GravityModel) -> list[Target] | None:
    if args.settle is None:
        return None
    return [Target(request.effect.name, request.joint)
            for request in requests(args.settle.split(','), model.joints)]


def _options(args: argparse.Namespace, model: GravityModel) -> PlanOptions:
    low = high = None
    reach = args.reach
    if args.within == 'limits':
        if args.urdf is None:
            raise OptionError('--within limits needs the limits: --urdf FILE')
        from gravity_comp_ros.description.joint_limits import position_limits
        from gravity_comp_ros.description.urdf import read_text
        low, high = position_limits(read_text(args.urdf), model.joints, str(args.urdf))
        # A margin of 2 % at either end: a planned motion should not end at a stop.
        low, high = low + 0.02 * (high - low), high - 0.02 * (high - low)
        reach = float('inf')
    return PlanOptions(args.duration, args.max_speed, args.max_acceleration, args.max_jerk, reach,
                       low=low, high=high, start=args.start)


def _show(args: argparse.Namespace, found: Plan) -> None:
    length = f'{found.trajectory.duration:.1f} s'
    terminal.show(f'[bold]{len(found.parts)} parts, {length}[/bold]')
    for part in found.parts:
        terminal.show(terminal.safe('  ' + part.sentence))
    rows = [[e.target.name, f'{100 * e.chance_before:.0f} %', f'{100 * e.chance:.0f} %',
             _widths(e), e.hardest or '–'] for e in found.expectations]
    columns = ['to settle', 'chance now', 'chance then', 'coefficient, 95 %',
               'closest alternative']
    terminal.show('', terminal.table('what to expect', columns, rows, columns[3:]))
    start = ', '.join(f'{value:.3f}' for value in found.trajectory.q[0])
    terminal.show('', terminal.safe(f'bring the arm to {start} rad first'),
                  'obstacles are not known here: keep the space around the arm clear',
                  terminal.safe(f'written to {args.output}'))


def _widths(expected: Expectation) -> str:
    return ', '.join(f'{symbol} ± {width:.2g} {unit}'.strip() if np.isfinite(width) else
                     f'{symbol} unknown' for symbol, (width, unit) in expected.half_width.items())


def _to_json(found: Plan) -> dict[str, Any]:
    trajectory = found.trajectory
    return {
        'duration_s': trajectory.duration, 'joints': list(trajectory.joints),
        'start': trajectory.q[0].tolist(),
        'parts': [{'start': p.start, 'end': p.end, 'joints': list(p.joints), 'what': p.what,
                   'settles': list(p.settles), 'sentence': p.sentence} for p in found.parts],
        'expected': [_expected_json(expected) for expected in found.expectations],
        'notes': list(found.notes)}


def _expected_json(e: Expectation) -> dict[str, Any]:
    widths = {symbol: {'value': width if np.isfinite(width) else None, 'unit': unit}
              for symbol, (width, unit) in e.half_width.items()}
    return {'effect': e.target.effect, 'joint': e.target.joint,
            'chance_before': e.chance_before, 'chance': e.chance,
            'closest_alternative': e.hardest or None, 'assumed': e.assumed,
            'size_is_measured': e.measured, 'half_width': widths}


def _motion_file(text: str) -> Path:
    path = Path(text)
    if path.suffix not in ENDINGS:
        raise argparse.ArgumentTypeError(f'{text} does not end in {", ".join(ENDINGS)}')
    return path


def _pose(text: str) -> FloatArray:
    return np.array([arguments.finite(part) for part in text.split(',')])
