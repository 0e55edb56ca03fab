"""What `gravity_comp add` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp add coulomb_friction:elbow --model arm.json run1.mcap run2.mcap
  gravity_comp add coulomb_friction,viscous_friction --model arm.json run1.mcap
                                       on every joint that can show them
  gravity_comp add torque_offset:wrist --model arm.json run1.mcap --dry-run
  gravity_comp add --undo --model arm.json

Gravity and effects are fitted together to the whole recordings. Slow samples count, unless they
are few or the effect shows in fast motion only (inertia, Coriolis, delay); --all-samples and
--max-speed say otherwise. Errors are of data that was not fitted: whole runs, or blocks of time.
Where another effect would explain the recordings as well, that is said: the best of a tie can be
added, so that the error falls today. docs/effects.md describes every effect.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `add`."""
    parser.add_argument('effects', metavar='EFFECT[:JOINT]', nargs='?',
                        help='what to add, several with commas; without a joint, on every joint '
                        'that can show it')
    arguments.add_bags(parser, nargs='*')
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='the model to change')
    parser.add_argument('--undo', action='store_true',
                        help='take back what was added last; needs no bag')
    parser.add_argument('--dry-run', action='store_true', help='show, but write nothing')
    parser.add_argument('--holdout', action='store_true',
                        help='show the error on what `fit --holdout` held out as well; that part '
                        'is never fitted')
    speeds = parser.add_argument_group('samples that are fitted')
    speeds.add_argument('--max-speed', metavar='RAD/S', type=arguments.positive,
                        help='only where every joint is slower (default: 0.15, see below)')
    speeds.add_argument('--all-samples', action='store_true', help='fast ones too')
    arguments.add_reading(parser, joints=False)
    arguments.add_json(parser)
    parser.set_defaults(output=None, rewrites_model=True)
