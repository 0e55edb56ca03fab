"""Arguments of the verbs for recordings: synth, convert, cut, info."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments
from gravity_comp_ros.recordings.units import (
    ANGLE_HELP, CURRENT_UNITS, SHARE_UNITS, TIME_UNITS, TORQUE_UNITS)
from gravity_comp_ros.simulation.hidden import size_table

MOTIONS = ('eq15', 'eq17', 'random', 'multisine')
FILES = ('.yaml', '.yml')


@arguments.verb('record a simulated arm with motion, payload, hidden effects and noise', f"""\
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
""")
def synth(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `synth`."""
    _add_recording_output(parser)
    parser.add_argument('--seed', type=int, default=0,
                        help='seed of random motion and noise (default: 0)')
    group = parser.add_argument_group('arm')
    group.add_argument('--arm', metavar='iiwa7|FILE.urdf', default='iiwa7',
                       help='KUKA LBR iiwa 7 R800, or any arm of revolute joints')
    group.add_argument('--tilt', metavar=('ROLL', 'PITCH'), nargs=2, type=arguments.number(
        float, 'within -180 to 180 degrees', lambda value: abs(value) <= 180.0),
                       default=(0.0, 0.0),
                       help='tilt of the base, -180 to 180 degrees (default: level)')
    group.add_argument('--joint-names', metavar='A,B,...', type=arguments.joint_list,
                       help='joint names in the output (default: those of the arm)')
    group = parser.add_argument_group('motion')
    group.add_argument('--motion', metavar='NAME|FILE', type=_motion_name, default='eq17',
                       help=f'{", ".join(MOTIONS)} (see below), or a motion written by `plan` '
                       '(.yaml) (default: eq17)')
    group.add_argument('--duration', metavar='S', type=arguments.positive, help='length in s')
    group.add_argument('--rate', metavar='HZ', type=arguments.positive, help='samples per second')
    group.add_argument('--samples', metavar='N', type=arguments.count,
                       help='number of samples, instead of a duration')
    group.add_argument('--start', metavar='S', type=arguments.finite, default=0.0,
                       help='start time within the motion (default: 0)')
    group.add_argument('--max-speed', metavar='RAD/S', type=arguments.positive,
                       help='maximum speed of every joint in a multisine (default: 0.1)')
    group = parser.add_argument_group('torque')
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
    group.add_argument('--static', action='store_true',
                       help='gravity torque only, as if the arm stopped for every sample')


def _add_recording_output(parser: argparse.ArgumentParser) -> None:
    arguments.add_mcap_output(parser)
    parser.add_argument('--topic', default='/joint_states', help='(default: /joint_states)')
    arguments.add_json(parser)


def _motion_name(text: str) -> str:
    if text not in MOTIONS and Path(text).suffix not in FILES:
        raise argparse.ArgumentTypeError(f'no motion {text}; give one of {", ".join(MOTIONS)}, '
                                         f'or a {" or ".join(FILES)} file')
    return text


@arguments.verb('convert a CSV or Parquet file of any columns and units to an MCAP file', """\
columns (--time, --position, --velocity, --effort):
  q_{i}      all columns with a number in place of {i}, in order: q_0, q_1, ...
  a,b,c      columns by name
  2-8        columns by number, counted from 1
  none       no such column (for --time and --velocity)
Without these options common names are searched: t or time, q_{i}, qd_{i}, tau_{i} and similar, and
names that include the joint, such as /joint_states/elbow/position (PlotJuggler), position_elbow or
elbow.pos. Files of `ros2 topic echo --csv`, rostopic and bagpy, and LeRobot data sets (Parquet,
with pyarrow) are read without further options.
Decimal commas are accepted between semicolons or tabs. Times may be dates with a time of day.

examples:
  gravity_comp convert log.csv -o log.mcap
  gravity_comp convert servos.csv --position-unit ticks=4096 --effort-unit permille \
      --rated-torque 3 -o servos.mcap
  gravity_comp convert lbr.csv --rate 100 --effort-sign -1 -o lbr.mcap
  gravity_comp convert log.txt --time 1 --position 2-7 --effort 8-13 --time-unit ms \\
      --position-unit deg --effort-unit mA --torque-constant 0.06 --gear-ratio 101 -o log.mcap
""")
def convert(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `convert`."""
    parser.add_argument('table', metavar='TABLE', type=Path,
                        help='a .csv, .txt or .parquet file, or the folder of a LeRobot '
                        'data set')
    _add_recording_output(parser)
    group = parser.add_argument_group('columns')
    for what in ('time', 'position', 'velocity', 'effort'):
        group.add_argument(f'--{what}', metavar='COLUMNS', help=f'columns of {what}')
    group.add_argument('--rate', metavar='HZ', type=arguments.positive,
                       help='sampling rate of a table without a time column (--time none '
                       'ignores the column)')
    group.add_argument('--joint-names', dest='joints', metavar='A,B,...',
                       type=arguments.joint_list,
                       help='joint names in the output (default: joint_1, joint_2, ...)')
    group = parser.add_argument_group('units and signs (one value, or one per joint)')
    group.add_argument('--time-unit', choices=tuple(TIME_UNITS),
                       help='(default: s; required if the values contradict it)')
    group.add_argument('--position-unit', metavar='UNIT', type=arguments.position_unit,
                       help=f'of positions and velocities: {ANGLE_HELP} (default: rad; required '
                       'if the values contradict it); sign bits of ticks are detected')
    group.add_argument('--effort-unit', choices=(*TORQUE_UNITS, *CURRENT_UNITS, *SHARE_UNITS),
                       default='Nm', help='A and mA require --torque-constant, percent and '
                       'permille --rated-torque (default: %(default)s)')
    group.add_argument('--effort-sign', metavar='1|-1,...', type=arguments.numbers, default=(1.0,),
                       help='-1 if the file lists the load torque on the drive instead of the '
                       'drive torque (for several: --effort-sign=-1,1,...)')
    group.add_argument('--torque-constant', metavar='NM/A,...', type=arguments.numbers,
                       help='motor torque constant, for efforts in A or mA')
    group.add_argument('--rated-torque', metavar='NM,...', type=arguments.numbers,
                       help='torque of the joint at 100 %%, for efforts in percent or permille')
    group.add_argument('--gear-ratio', metavar='N,...', type=arguments.numbers, default=(1.0,),
                       help='motor revolutions per joint revolution (default: 1)')
    group = parser.add_argument_group('the file')
    header = group.add_mutually_exclusive_group()
    header.add_argument('--header', action='store_true', default=None,
                        help='the first line has names (default: if it contains no number)')
    header.add_argument('--no-header', dest='header', action='store_false',
                        help='the first line has numbers')
    group.add_argument('--delimiter', metavar='CHAR', help='column separator (default: detected)')
    group.add_argument('--skip-bad-rows', action='store_true',
                       help='omit rows with empty or non-finite cells or decreasing time')


@arguments.verb('extract a part of a recording by time and joints, or split it', """\
examples:
  gravity_comp cut run1.mcap -o start.mcap --to 60            the first minute
  gravity_comp cut run1.mcap -o middle.mcap --from 20 --to 50 --joints shoulder,elbow
  gravity_comp cut run1.mcap -o part.mcap --split 60,120      part-1.mcap, part-2.mcap, part-3.mcap

Times are in s from the first sample. Efforts, stamps and /robot_description are copied unchanged,
so the parts share one clock. Invalid messages are dropped, as in every verb.
""", arguments.add_mcap_output, arguments.add_topic_and_joints, arguments.add_json)
def cut(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `cut`."""
    arguments.add_bags(parser, nargs=None)
    parser.add_argument('--from', dest='begin', metavar='S', type=arguments.finite, default=0.0,
                        help='begin of the part (default: 0)')
    parser.add_argument('--to', dest='end', metavar='S', type=arguments.positive,
                        help='end of the part (default: end of the recording)')
    parser.add_argument('--split', metavar='S,S,...', type=times, default=(),
                        help='split at these times into numbered files')


def times(text: str) -> tuple[float, ...]:
    """Return the increasing times in `60,120`."""
    values = tuple(arguments.positive(part) for part in text.split(','))
    if any(later <= earlier for earlier, later in zip(values, values[1:])):
        raise argparse.ArgumentTypeError(f'{text!r}: the times must increase')
    return values


@arguments.verb('list joints, speeds and coverage of a recording, and its limitations', """\
columns of the table:
  range      minimum and maximum angle, in rad
  travel     distance from minimum to maximum angle, in rad
  rms, max   speed in rad/s; the slow-motion gate requires all joints slow at the same time
  reversals  changes of direction; they excite friction
  effort     minimum and maximum, in N·m (or in the unit of the driver)

examples:
  gravity_comp info run1.mcap
  gravity_comp info rosbag2_folder/ old.db3 --max-speed 0.2
  gravity_comp info run1.mcap --json
""", arguments.add_bags, arguments.add_reading, arguments.add_gate, arguments.add_json)
def info(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `info`."""
    arguments.add_urdf(parser, 'axes to compare the directions and zeros of the joints with')
