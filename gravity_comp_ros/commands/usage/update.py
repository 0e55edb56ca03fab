"""What `gravity_comp update` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp update tool.mcap --model arm.json -o with_tool.json
  gravity_comp update tool.mcap --model arm.json --urdf robot.urdf -o with_tool.json
                                       weighs the tool: mass and centre of mass
  gravity_comp update tool.mcap --model arm.json        changes arm.json itself
  gravity_comp update --undo --model arm.json           takes that back

which recordings: ten seconds or more of slow motion that turns every joint by tens of degrees.
The recordings hold the arm with its new payload and nothing else. The model must be a chain or a
potential; a chain (`fit --formulation chain`) needs far fewer samples. With --urdf the new
model is a chain whatever the old one was. Effects of the model stay as they are.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `update`."""
    arguments.add_bags(parser, nargs='*')
    parser.add_argument('--model', metavar='MODEL.json', type=Path, required=True,
                        help='the model of the arm before the change')
    parser.add_argument('-o', '--output', metavar='NEW.json', type=Path,
                        help='write the new model here (default: over the old one, which --undo '
                        'brings back)')
    parser.add_argument('--undo', action='store_true',
                        help='take the last change of the model back; needs no bag')
    parser.add_argument('--dry-run', action='store_true', help='show, but write nothing')
    arguments.add_urdf(parser, 'where the axes of the arm are: gives mass and centre of mass')
    arguments.add_gate(parser)
    arguments.add_reading(parser, joints=False)
    arguments.add_json(parser)
    parser.set_defaults(rewrites_model=True)
