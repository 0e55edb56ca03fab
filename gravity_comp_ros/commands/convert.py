r"""
Convert a CSV or Parquet file of any columns and units to an MCAP file.

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

For example:
  gravity_comp convert log.csv -o log.mcap
  gravity_comp convert servos.csv --position-unit ticks=4096 --effort-unit permille \
      --rated-torque 3 -o servos.mcap
  gravity_comp convert lbr.csv --rate 100 --effort-sign -1 -o lbr.mcap
  gravity_comp convert log.txt --time 1 --position 2-7 --effort 8-13 --time-unit ms \
      --position-unit deg --effort-unit mA --torque-constant 0.06 --gear-ratio 101 -o log.mcap
"""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path

from gravity_comp_ros.commands import arguments, next_step
from gravity_comp_ros.commands.terminal import Answer
from gravity_comp_ros.printable import counted, shown_names
from gravity_comp_ros.recordings.mcap_writer import write_bag
from gravity_comp_ros.recordings.table import read_table, TableOptions
from gravity_comp_ros.recordings.units import ANGLE_HELP, EFFORT_UNITS, TIME_UNITS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `convert`."""
    parser.add_argument('table', metavar='TABLE', type=Path,
                        help='a .csv, .txt or .parquet file, or the folder of a LeRobot '
                        'data set')
    arguments.add_recording_output(parser)
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
    group.add_argument('--effort-unit', choices=tuple(EFFORT_UNITS),
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


def run(args: argparse.Namespace) -> Answer:
    options = TableOptions(**{one.name: getattr(args, one.name) for one in fields(TableOptions)})
    converted = read_table(args.table, options, args.topic)
    write_bag(args.output, [converted.topic], converted.start_ns)
    topic = converted.topic
    bad = [f'{counted(converted.dropped, "bad row")} omitted'] if converted.dropped else []
    return Answer(
        {'input': str(args.table), 'output': str(args.output), 'joints': topic.joints,
         'n_samples': len(topic.t), 'duration_s': topic.t[-1],
         'velocity': topic.velocity is not None, 'dropped_rows': converted.dropped,
         'notes': converted.notes},
        [f'wrote {args.output}: {counted(len(topic.t), "sample")} over {topic.t[-1]:.4g} s, '
         f'joints {shown_names(topic.joints)}', *next_step.check_recordings(args.output)],
        [*bad, *converted.notes])
