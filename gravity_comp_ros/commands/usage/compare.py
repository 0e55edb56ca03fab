"""Arguments of `gravity_comp compare`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp compare run2.mcap --model arm.json
  gravity_comp compare run1.mcap --model arm.json --holdout      only the held-out part of run1
  gravity_comp compare fast.mcap --model arm.json --all-samples --json errors.json
  gravity_comp compare run2.mcap --model arm.json --html report.html      report with plots

which recordings: recordings that were not fitted, with the payload of the model. Errors on fitted
recordings are too small. For a held-out error use `fit --holdout`, then --holdout here.

RMSE, std and max are of the residual, measured minus predicted torque. nRMSE is RMSE over the
range of the measured torque (Yu 2022, Eq. 16); it is meaningless for joints without gravity load.
"in band" is the share of residuals inside the 95 % prediction band within the trained range;
"outside" is the same share for poses outside the trained range. A share near 95 % confirms the
band. A share far below 95 % indicates a changed payload or a missing effect. A share of 100 %
means that the band is too wide, often where few samples were trained.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `compare`."""
    arguments.add_bags(parser)
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='model file, written by `fit`')
    parser.add_argument('--holdout', action='store_true',
                        help='of the fitted bags, use only the data that `fit --holdout` '
                        'held out')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
    arguments.add_html(parser)
    parser.add_argument('--previous', metavar='MODEL.json', type=Path, default=None,
                        help='second model whose errors the --html report also lists '
                        '(default: the model before its last addition)')
