"""Arguments of `gravity_comp plan`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

# Copies from `recordings.trajectory_files` and `planning.PlanOptions`, so that --help does not
# import them; a test compares both.
ENDINGS = ('.yaml', '.yml', '.csv', '.mcap')
REACH = 0.3
LIMITS = (('duration', 'S', 20.0, 'maximum duration'),
          ('max_speed', 'RAD/S', 0.3, 'of every joint'),
          ('max_acceleration', 'RAD/S²', 1.0, 'of every joint'),
          ('max_jerk', 'RAD/S³', 10.0, 'of every joint'))
EPILOG = """\
examples:
  gravity_comp plan run1.mcap --model arm.json -o motion.yaml
  gravity_comp plan run1.mcap --model arm.json --settle coulomb_friction:elbow -o motion.csv
  gravity_comp plan run1.mcap --model arm.json --within limits --urdf robot.urdf -o motion.yaml
  gravity_comp plan run1.mcap --model arm.json --widen 0.7 -o motion.yaml
  ros2 topic pub --once /joint_trajectory_controller/joint_trajectory \\
      trajectory_msgs/msg/JointTrajectory "$(cat motion.yaml)"
  gravity_comp synth --motion motion.yaml -o new.mcap              simulate it
  gravity_comp plan run1.mcap --model arm.json --json plan.json -o motion.yaml
  gravity_comp diagnose run1.mcap new.mcap --model arm.json --plan plan.json   check the result

The motion begins and ends at rest at one recorded pose. It stays near recorded poses and moves one
to three joints at a time, or all joints if more have targets. Move the arm to the first point
before playing it. Obstacles and people are not checked: keep the space clear. With --urdf and
pinocchio, self-collisions of the arm are checked.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `plan`."""
    arguments.add_bags(parser)
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='gravity model of the arm (chain or potential)')
    parser.add_argument('-o', '--output', metavar='MOTION', type=_motion_file, required=True,
                        help=f'motion file to write ({", ".join(ENDINGS)})')
    parser.add_argument('--settle', metavar='EFFECT:JOINT,...', default=None,
                        help='effects to resolve; `gravity` for poses with a large uncertainty '
                        'of the model (default: effects that `diagnose` reports as ambiguous, '
                        'untestable or weak, and gravity where it is uncertain)')
    group = parser.add_argument_group('limits')
    group.add_argument('--within', choices=('recorded', 'limits'), default='recorded',
                       help='near recorded poses, or within the position limits of --urdf '
                       '(default: recorded)')
    group.add_argument('--urdf', metavar='FILE.urdf', type=Path, default=None,
                       help='robot description: collision geometry for the self-collision check, '
                       'and position limits for --within limits')
    group.add_argument('--reach', metavar='RAD', type=arguments.positive, default=REACH,
                       help='maximum distance of each joint from a recorded pose '
                       '(default: %(default)s)')
    group.add_argument('--widen', metavar='RAD', type=arguments.positive, default=None,
                       help='extend the recorded range of every joint by this angle, in any pose '
                       'of the others, within the limits of --urdf if given; check that the '
                       'arm has the space')
    for name, unit, default, what in LIMITS:
        group.add_argument('--' + name.replace('_', '-'), metavar=unit, type=arguments.positive,
                           default=default, help=f'{what} (default: %(default)s)')
    group.add_argument('--start', metavar='RAD,...', type=_pose, default=None,
                       help='start and end pose, one value for each joint of the model '
                       '(default: a recorded pose near the middle)')
    group = parser.add_argument_group('output')
    group.add_argument('--goal', action='store_true',
                       help='write YAML as the goal of a FollowJointTrajectory action')
    group.add_argument('--effort', action='store_true',
                       help="add the model's gravity torque as effort")
    arguments.add_reading(parser, joints=False)
    arguments.add_json(parser)


def _motion_file(text: str) -> Path:
    path = Path(text)
    if path.suffix not in ENDINGS:
        raise argparse.ArgumentTypeError(f'{text} does not end in {", ".join(ENDINGS)}')
    return path


def _pose(text: str) -> tuple[float, ...]:
    return tuple(arguments.finite(part) for part in text.split(','))
