"""Arguments of `gravity_comp update`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp update tool.mcap --model arm.json -o with_tool.json
  gravity_comp update tool.mcap --model arm.json --urdf robot.urdf -o with_tool.json
                                       also mass and centre of mass of the tool
  gravity_comp update tool.mcap --model arm.json        changes arm.json in place
  gravity_comp update --undo --model arm.json           restores it

which recordings: at least ten seconds of slow motion that rotates every joint by tens of degrees,
recorded with the new payload only. The model must be a chain or a potential; a chain
(`fit --formulation chain`) requires far fewer samples. With --urdf the new model is always a
chain. Effects of the model are kept unchanged.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `update`."""
    arguments.add_bags(parser, nargs='*')
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='model of the arm before the payload change')
    parser.add_argument('-o', '--output', metavar='NEW.json', type=Path,
                        help='model file to write (default: replaces the old model, which '
                        '--undo restores)')
    parser.add_argument('--undo', action='store_true',
                        help='undo the last update of the model; needs no bag')
    parser.add_argument('--dry-run', action='store_true', help='show the result, write nothing')
    arguments.add_urdf(parser, 'joint axes, for the mass and centre of mass of the payload')
    parser.add_argument('--flange', metavar='LINK', default=None,
                        help='link of --urdf in whose frame the centre of mass is given, such as '
                        'tool0 (default: the link of the last joint)')
    arguments.add_gate(parser)
    arguments.add_reading(parser, joints=False)
    arguments.add_json(parser)
    parser.set_defaults(rewrites_model=True)
