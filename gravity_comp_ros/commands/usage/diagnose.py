"""What `gravity_comp diagnose` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp diagnose run1.mcap run2.mcap --model arm.json
  gravity_comp diagnose run1.mcap                         beside a model fitted on the spot
  gravity_comp diagnose run1.mcap --effects coulomb_friction,viscous_friction --json
  gravity_comp diagnose run1.mcap --model arm.json --html report.html    plots to look at
  gravity_comp diagnose run1.mcap new.mcap --model arm.json --plan plan.json   was it settled

which recordings: those of the fit and any others of the same arm with the same payload, fast ones
too. More runs settle more; errors are always of blocks that were left out.

verdicts:
  established   it explains held-out data, in nearly every run, and nothing else does: add it
  likely        the same, less surely: add it
  ambiguous     another effect explains as much: both are named, and the motion that settles it.
                One of them may be added today; never both
  weak          perhaps there, too small to be sure: leave it out
  untestable    this motion cannot distinguish it from another effect: leave it out
  unexplained   something repeats there that no known effect describes
What is established or likely was chosen together, so add it all at once, by the printed command.

All samples are used, fast ones too: inertia is an effect like any other. Errors are of data that
was not fitted, as a share of the range of the measured torque (Yu 2022, Eq. 16).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `diagnose`."""
    arguments.add_bags(parser)
    parser.add_argument('--model', metavar='MODEL.json', type=Path,
                        help='the model to judge, as `fit` writes it (default: one is fitted)')
    parser.add_argument('--effects', metavar='A,B,...', type=arguments.joint_list, default=None,
                        help='look for these effects only (default: all that are known)')
    parser.add_argument('--holdout', action='store_true',
                        help='leave out what `fit --holdout` held out, and check that there is '
                        'some; with a model that part is left out anyway')
    parser.add_argument('--plan', metavar='PLAN.json', type=Path, default=None,
                        help='compare with what `plan --json PLAN.json` expected of the new '
                        'recording')
    arguments.add_reading(parser)
    arguments.add_json(parser)
    arguments.add_html(parser, f'{arguments.DRAWN}; without --model its axes are those of the '
                       'arm')
