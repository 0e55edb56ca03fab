"""Arguments of `gravity_comp synth`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments
from gravity_comp_ros.simulation.hidden_sizes import size_table

EPILOG = f"""\
motions:
  eq15       seven joints, up to 3.1 rad/s: the test motion of Yu 2022 (20 s at 10 Hz)
  eq17       seven joints, up to 0.11 rad/s: its slow training motion (100 s at 5 Hz)
  random     poses at rest, uniform within the joint limits, 2 s apart (1000 poses)
  FILE.yaml  a motion written by `gravity_comp plan` (50 Hz)
  multisine  seeded sums of sines within the limits, for any arm (100 s at 50 Hz)

hidden effects and their SIZE, in the units of `diagnose`:
{size_table()}
  JOINT is a name or a number from 1. The default SIZE exceeds the noise of a typical arm.

examples:
  gravity_comp synth --motion eq17 --noise 0.1 -o slow.mcap
  gravity_comp synth --motion eq17 --start 100 --noise 0.1 --seed 1 -o later.mcap
  gravity_comp synth --motion eq17 --payload 2 --payload-at 50 -o loaded.mcap
  gravity_comp synth --motion multisine --hidden coulomb_friction:4=0.8 -o rough.mcap
  gravity_comp synth --motion random --samples 1000 --relative-noise 0.01 -o poses.mcap
  gravity_comp synth --arm robot.urdf --motion multisine --max-speed 0.1 -o robot.mcap
"""
MOTIONS = ('eq15', 'eq17', 'random', 'multisine')
FILES = ('.yaml', '.yml', '.csv')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `synth`."""
    parser.add_argument('-o', '--output', metavar='OUT.mcap', type=arguments.mcap_file,
                        required=True, help='file to write; an existing file is replaced')
    parser.add_argument('--seed', type=int, default=0,
                        help='seed of random motion and noise (default: 0)')
    parser.add_argument('--topic', default='/joint_states', help='(default: /joint_states)')
    arguments.add_json(parser)
    _add_arm(parser.add_argument_group('arm'))
    _add_motion(parser.add_argument_group('motion'))
    _add_torque(parser.add_argument_group('torque'))


def _add_arm(group: argparse._ArgumentGroup) -> None:
    group.add_argument('--arm', metavar='iiwa7|FILE.urdf', default='iiwa7',
                       help='KUKA LBR iiwa 7 R800, or any arm of revolute joints')
    group.add_argument('--tilt', metavar=('ROLL', 'PITCH'), nargs=2, type=angle,
                       default=(0.0, 0.0),
                       help='tilt of the base, -180 to 180 degrees (default: level)')
    group.add_argument('--joint-names', metavar='A,B,...', type=arguments.joint_list,
                       help='joint names in the output (default: those of the arm)')


def _add_motion(group: argparse._ArgumentGroup) -> None:
    group.add_argument('--motion', metavar='NAME|FILE', type=_motion_name, default='eq17',
                       help=f'{", ".join(MOTIONS)} (see below), or a motion written by `plan` '
                       '(.yaml or .csv) (default: eq17)')
    group.add_argument('--duration', metavar='S', type=arguments.positive, help='length in s')
    group.add_argument('--rate', metavar='HZ', type=arguments.positive, help='samples per second')
    group.add_argument('--samples', metavar='N', type=arguments.count,
                       help='number of samples, instead of a duration')
    group.add_argument('--start', metavar='S', type=arguments.finite, default=0.0,
                       help='start time within the motion (default: 0)')
    group.add_argument('--max-speed', metavar='RAD/S', type=arguments.positive,
                       help='maximum speed of every joint in a multisine (default: 0.1)')


def _add_torque(group: argparse._ArgumentGroup) -> None:
    group.add_argument('--payload', metavar='KG', type=arguments.positive,
                       help='mass on the last link')
    group.add_argument('--payload-com', metavar=('X', 'Y', 'Z'), nargs=3, type=arguments.finite,
                       help="its centre of mass in the last joint's frame, in m "
                       '(default: 0 0 0.1)')
    group.add_argument('--payload-at', metavar='S', type=arguments.finite,
                       help='time from the start until it is attached (default: 0)')
    group.add_argument('--hidden', metavar='EFFECT:JOINT[=SIZE]', action='append', default=[],
                       help='unmodelled effect, simulated with other formulas than those of '
                       'the diagnosis; may be repeated (effects and units: see below)')
    group.add_argument('--noise', metavar='NM', type=arguments.finite, default=0.0,
                       help='standard deviation of the torque noise, N·m (default: 0)')
    group.add_argument('--relative-noise', metavar='FRACTION', type=arguments.finite, default=0.0,
                       help='the same as a fraction of the torque (default: 0)')
    group.add_argument('--noise-correlation', metavar='S', type=arguments.finite, default=0.0,
                       help='correlation time of --noise (default: 0, white)')
    group.add_argument('--static', action='store_true',
                       help='gravity torque only, as if the arm stopped for every sample')


def angle(text: str) -> float:
    """Return an angle within half a turn, in degrees."""
    value = arguments.finite(text)
    if abs(value) > 180.0:
        raise argparse.ArgumentTypeError(f'{text!r} is not within -180 to 180 degrees')
    return value


def _motion_name(text: str) -> str:
    if text not in MOTIONS and Path(text).suffix not in FILES:
        raise argparse.ArgumentTypeError(f'no motion {text}; give one of {", ".join(MOTIONS)}, '
                                         f'or a {" or ".join(FILES)} file')
    return text
