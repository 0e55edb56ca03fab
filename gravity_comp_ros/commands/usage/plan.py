"""What `gravity_comp plan` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

# Those of `recordings.trajectory_files` and of `planning.PlanOptions`, which would have to be
# loaded for --help; a test compares them.
ENDINGS = ('.yaml', '.yml', '.csv', '.mcap')
REACH = 0.3
LIMITS = (('duration', 'S', 20.0, 'longest motion'),
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
  gravity_comp synth --motion motion.yaml -o new.mcap              plays it on a simulated arm
  gravity_comp plan run1.mcap --model arm.json --json plan.json -o motion.yaml
  gravity_comp diagnose run1.mcap new.mcap --model arm.json --plan plan.json   what is settled now

The motion begins and ends at rest at one recorded pose, and moves one to three joints at a time,
or all of them where more are asked about, within recorded poses. Bring the arm to the first point
before it is played. Obstacles and people are not known here: keep the space clear. With --urdf and
pinocchio it is checked that the links of the arm do not hit each other.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `plan`."""
    arguments.add_bags(parser)
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='the gravity model of the arm (chain or potential)')
    parser.add_argument('-o', '--output', metavar='MOTION', type=_motion_file, required=True,
                        help=f'write the motion here ({", ".join(ENDINGS)})')
    parser.add_argument('--settle', metavar='EFFECT:JOINT,...', default=None,
                        help='settle these; `gravity` for the poses where the model is unsure '
                        '(default: what `diagnose` finds ambiguous, untestable or weak, and '
                        'gravity where it is unsure)')
    group = parser.add_argument_group('limits')
    group.add_argument('--within', choices=('recorded', 'limits'), default='recorded',
                       help='stay near recorded poses, or within the position limits of --urdf '
                       '(default: recorded)')
    group.add_argument('--urdf', metavar='FILE.urdf', type=Path, default=None,
                       help='the robot description: its collision geometry says whether links '
                       'hit each other, and --within limits takes its limits')
    group.add_argument('--reach', metavar='RAD', type=arguments.positive, default=REACH,
                       help='how far each joint may be from a recorded pose '
                       '(default: %(default)s)')
    group.add_argument('--widen', metavar='RAD', type=arguments.positive, default=None,
                       help='let every joint leave its recorded range by this much, in any pose '
                       'of the others, within the limits of --urdf if given; look whether the '
                       'arm has the room')
    for name, unit, usual, what in LIMITS:
        group.add_argument('--' + name.replace('_', '-'), metavar=unit, type=arguments.positive,
                           default=usual, help=f'{what} (default: %(default)s)')
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


def _motion_file(text: str) -> Path:
    path = Path(text)
    if path.suffix not in ENDINGS:
        raise argparse.ArgumentTypeError(f'{text} does not end in {", ".join(ENDINGS)}')
    return path


def _pose(text: str) -> tuple[float, ...]:
    return tuple(arguments.finite(part) for part in text.split(','))
