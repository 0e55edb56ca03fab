"""Arguments of `gravity_comp diagnose`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp diagnose run1.mcap run2.mcap --model arm.json
  gravity_comp diagnose run1.mcap                         without a model file
  gravity_comp diagnose run1.mcap --effects coulomb_friction,viscous_friction --json
  gravity_comp diagnose run1.mcap --model arm.json --html report.html    report with plots
  gravity_comp diagnose run1.mcap new.mcap --model arm.json --plan plan.json   check a plan

which recordings: the fitted recordings and any others of the same arm with the same payload, slow
or fast. More runs resolve more findings; errors are always held-out errors.

verdicts:
  established   strong evidence without an alternative, and a smaller held-out error: add it
  likely        the same with less evidence: add it
  ambiguous     another effect explains the data equally well; both are listed, with the motion
                that distinguishes them. Add at most one of them
  weak          hardly reduces the held-out error, or its size is not physical or not different
                from 0: do not add
  untestable    not identifiable with this motion: do not add
  unexplained   a repeating residual that no known effect describes
Established and likely effects were selected jointly: add all of them with the printed command.

All samples are used, including fast ones, because inertia is one of the effects. Errors are
held-out errors relative to the range of the measured torque (Yu 2022, Eq. 16).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `diagnose`."""
    arguments.add_bags(parser)
    parser.add_argument('--model', metavar='MODEL.json', type=Path,
                        help='model file, written by `fit` (default: a model is fitted)')
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list, default=None,
                        help='test these effects only (default: all known effects)')
    parser.add_argument('--holdout', action='store_true',
                        help='require that `fit --holdout` held out data; with --model that '
                        'data is always excluded')
    parser.add_argument('--plan', metavar='PLAN.json', type=Path, default=None,
                        help='compare with the expectations of `plan --json PLAN.json`')
    arguments.add_reading(parser)
    arguments.add_json(parser)
    arguments.add_html(parser, f'{arguments.DRAWN}; without --model, also the joint axes')
