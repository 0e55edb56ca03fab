"""Arguments of `gravity_comp fit`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp fit run1.mcap run2.mcap -o arm.json
  gravity_comp fit run1.mcap --holdout -o arm.json      report the held-out error
  gravity_comp fit run1.db3 --joints a1,a2,a3 --effort-scale a1=-1,a2=-1,a3=-1 -o arm.json
  gravity_comp fit run1.mcap --effects coulomb_friction,torque_offset:wrist -o arm.json
  gravity_comp fit run1.mcap --formulation per_joint --json report.json -o paper.json
  gravity_comp fit run1.mcap --urdf robot.urdf -o arm.json   chain with known axes

which recordings: slow motion (every joint under 0.15 rad/s) through the poses of the task, every
joint in both directions, with a constant payload; a minute or more, two runs rather than one.

Gravity is fitted jointly with friction, inertia and other effects, to slow samples, or to all if
fewer than 100 of at least 200 are slow. With --holdout the saved model is fitted without the
held-out data; `compare --holdout` uses that data.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fit`."""
    arguments.add_bags(parser)
    parser.add_argument('-o', '--output', metavar='MODEL.json', type=Path,
                        help='model file to write (without it, the fit is only shown)')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS, default=None,
                        help='potential: one potential energy for all joints; chain: potential '
                        'energy of a serial arm; auto: the chain if its residual is white or '
                        'small, else the one of these two with the smaller held-out error; '
                        'per_joint: each joint separately, as in Yu 2022 '
                        '(default: auto; chain with --urdf)')
    parser.add_argument('--holdout', metavar='SHARE', type=arguments.positive, nargs='?',
                        const=0.2, default=None, help='share of the data held out of the fit '
                        'for the error: whole runs, or blocks of a single run (0.2 if no number '
                        'is given)')
    parser.add_argument('--terms', metavar='N', type=arguments.count, default=8,
                        help='number of terms shown of each equation (default: %(default)s)')
    parser.add_argument('--effects', metavar='A,B:JOINT,...', default=None,
                        help='effects fitted jointly with gravity; without a joint, on every '
                        'joint where they are identifiable (docs/effects.md lists all)')
    arguments.add_urdf(parser, 'joint axes of the chain')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
