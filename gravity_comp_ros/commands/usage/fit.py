"""What `gravity_comp fit` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp fit run1.mcap run2.mcap -o arm.json
  gravity_comp fit run1.mcap --holdout -o arm.json      judge on data that is not fitted
  gravity_comp fit run1.db3 --joints a1,a2,a3 --effort-scale a1=-1,a2=-1,a3=-1 -o arm.json
  gravity_comp fit run1.mcap --effects coulomb_friction,torque_offset:wrist -o arm.json
  gravity_comp fit run1.mcap --formulation per_joint --json report.json -o paper.json
  gravity_comp fit run1.mcap --urdf robot.urdf -o arm.json   a chain whose axes are known

which recordings: slow motion (every joint under 0.15 rad/s) through the poses of the task, every
joint to and fro, the payload the same throughout; a minute or more, better two runs than one.

Slow samples are used; where they are too few, all are, with inertia fitted beside gravity. With
--holdout the saved model is the one that was judged; `compare --holdout` finds the same data.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `fit`."""
    arguments.add_bags(parser)
    parser.add_argument('-o', '--output', metavar='MODEL.json', type=Path,
                        help='write the model here (without it, only show what a fit gives)')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS, default=None,
                        help='one potential energy for all joints; the same with the structure '
                        'of a serial arm (chain); whichever of the two predicts held-out data '
                        'better (auto); or each joint by itself as in Yu 2022 (default: '
                        'auto, with --urdf chain)')
    parser.add_argument('--holdout', metavar='SHARE', type=arguments.positive, nargs='?',
                        const=0.2, default=None, help='hold this share of the data out of the '
                        'fit and judge the model on it: whole runs, or blocks of a single run '
                        '(0.2 if no number is given)')
    parser.add_argument('--terms', metavar='N', type=arguments.count, default=8,
                        help='terms of each equation to show (default: %(default)s)')
    parser.add_argument('--effects', metavar='A,B:JOINT,...', default=None,
                        help='learn these effects together with gravity; without a joint, on '
                        'every joint that can show them (docs/effects.md has them all)')
    arguments.add_urdf(parser, 'take the axes of the chain from here')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
