"""Arguments of `gravity_comp convert`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments
from gravity_comp_ros.recordings.units import (
    ANGLE_HELP, CURRENT_UNITS, SHARE_UNITS, TIME_UNITS, TORQUE_UNITS)

EPILOG = """\
columns (--time, --position, --velocity, --effort):
  q_{i}      all columns with a number in place of {i}, in order: q_0, q_1, ...
  a,b,c      columns by name
  2-8        columns by number, counted from 1
  none       no such column (for --time and --velocity)
  q          in an NPZ file, an array of M rows and N columns
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
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `convert`."""
    parser.add_argument('table', metavar='TABLE', type=Path,
                        help='a .csv, .txt, .npz or .parquet file, or the folder of a LeRobot '
                        'data set')
    parser.add_argument('-o', '--output', metavar='OUT.mcap', type=arguments.mcap_file,
                        required=True, help='file to write; an existing file is replaced')
    parser.add_argument('--topic', default='/joint_states', help='(default: /joint_states)')
    arguments.add_json(parser)
    _add_columns(parser.add_argument_group('columns'))
    _add_units(parser.add_argument_group('units and signs (one value, or one per joint)'))
    _add_text(parser.add_argument_group('the file'))


def _add_columns(group: argparse._ArgumentGroup) -> None:
    for what in ('time', 'position', 'velocity', 'effort'):
        group.add_argument(f'--{what}', metavar='COLUMNS', help=f'columns of {what}')
    group.add_argument('--rate', metavar='HZ', type=arguments.positive,
                       help='sampling rate of a table without a time column (--time none '
                       'ignores the column)')
    group.add_argument('--joint-names', metavar='A,B,...', type=arguments.joint_list,
                       help='joint names in the output (default: joint_1, joint_2, ...)')


def _add_units(group: argparse._ArgumentGroup) -> None:
    group.add_argument('--time-unit', choices=tuple(TIME_UNITS), default=None,
                       help='(default: s; required if the values contradict it)')
    group.add_argument('--position-unit', metavar='UNIT', type=arguments.position_unit,
                       help=f'of positions and velocities: {ANGLE_HELP} (default: rad; required '
                       'if the values contradict it); sign bits of ticks are detected')
    group.add_argument('--effort-unit', choices=(*TORQUE_UNITS, *CURRENT_UNITS, *SHARE_UNITS),
                       default='Nm', help='A and mA require --torque-constant, percent and '
                       'permille --rated-torque (default: %(default)s)')
    group.add_argument('--effort-sign', metavar='1|-1,...', type=numbers, default=(1.0,),
                       help='-1 if the file lists the load torque on the drive instead of the '
                       'drive torque (for several: --effort-sign=-1,1,...)')
    group.add_argument('--torque-constant', metavar='NM/A,...', type=numbers,
                       help='motor torque constant, for efforts in A or mA')
    group.add_argument('--rated-torque', metavar='NM,...', type=numbers,
                       help='torque of the joint at 100 %%, for efforts in percent or permille')
    group.add_argument('--gear-ratio', metavar='N,...', type=numbers, default=(1.0,),
                       help='motor revolutions per joint revolution (default: 1)')


def _add_text(group: argparse._ArgumentGroup) -> None:
    header = group.add_mutually_exclusive_group()
    header.add_argument('--header', action='store_true', default=None,
                        help='the first line has names (default: if it contains no number)')
    header.add_argument('--no-header', dest='header', action='store_false',
                        help='the first line has numbers')
    group.add_argument('--delimiter', metavar='CHAR', help='column separator (default: detected)')
    group.add_argument('--skip-bad-rows', action='store_true',
                       help='omit rows with empty or non-finite cells or decreasing time')


def numbers(text: str) -> tuple[float, ...]:
    """Return the numbers in `1,-1,...`."""
    return tuple(arguments.finite(part) for part in text.split(','))
