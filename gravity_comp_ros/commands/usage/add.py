"""Arguments of `gravity_comp add`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp add coulomb_friction:elbow --model arm.json run1.mcap run2.mcap
  gravity_comp add coulomb_friction,viscous_friction --model arm.json run1.mcap
                                       on every joint where they are identifiable
  gravity_comp add torque_offset:wrist --model arm.json run1.mcap --dry-run
  gravity_comp add --undo --model arm.json

Gravity and effects are fitted jointly. The fit uses slow samples if at least a fifth are slow,
else all; --all-samples and --max-speed override this. Errors are held-out errors, of whole runs or
of blocks of time. If another effect explains the recordings equally well, `add` lists it.
docs/effects.md describes every effect.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `add`."""
    parser.add_argument('effects', metavar='EFFECT[:JOINT]', nargs='?',
                        help='effects to add, separated by commas; without a joint, on every '
                        'joint where the effect is identifiable')
    arguments.add_bags(parser, nargs='*')
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='model file to change')
    parser.add_argument('--undo', action='store_true',
                        help='remove the last addition; needs no bag')
    parser.add_argument('--dry-run', action='store_true', help='show the result, write nothing')
    parser.add_argument('--holdout', action='store_true',
                        help='also show the error on the data that `fit --holdout` held out; '
                        'that data is never fitted')
    speeds = parser.add_argument_group('fitted samples')
    speeds.add_argument('--max-speed', metavar='RAD/S', type=arguments.positive,
                        help='upper limit of the speed of every joint (default: 0.15, see below)')
    speeds.add_argument('--all-samples', action='store_true', help='fast samples as well')
    arguments.add_reading(parser, joints=False)
    arguments.add_json(parser)
    parser.set_defaults(output=None, rewrites_model=True)
