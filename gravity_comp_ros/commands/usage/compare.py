"""What `gravity_comp compare` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp compare run2.mcap --model arm.json
  gravity_comp compare run1.mcap --model arm.json --holdout      only what `fit` held out of run1
  gravity_comp compare fast.mcap --model arm.json --all-samples --json errors.json
  gravity_comp compare run2.mcap --model arm.json --html report.html      plots to look at

which recordings: others than those of the fit, with the payload of the model. Errors on recordings
of the fit are too small; `fit --holdout` and then --holdout here judge on a part kept aside.

RMSE, std and max are of the error, measured minus predicted. nRMSE is RMSE over the range of
the measured torque (Yu 2022, Eq. 16); joints that carry no gravity have a meaningless one.
"in band" is the share of errors inside the 95 % band that the model itself gives, in its trained
range; "outside" is the same for poses outside of it. Near 95 % the band is right. Far below, the
model errs by more than it says: a payload has changed, or an effect is missing. 100 % says that
it errs by less than it says, as often where few samples lie.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `compare`."""
    arguments.add_bags(parser)
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='a model file, as `fit` writes it')
    parser.add_argument('--holdout', action='store_true',
                        help='of the bags that the model was fitted to, use only what '
                        '`fit --holdout` held out')
    arguments.add_gate(parser)
    arguments.add_reading(parser)
    arguments.add_json(parser)
    arguments.add_html(parser)
    parser.add_argument('--previous', metavar='MODEL.json', type=Path, default=None,
                        help='another model, for its errors beside in the report of --html '
                        '(default: what the model was before its last addition)')
