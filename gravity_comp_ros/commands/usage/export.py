"""Arguments of `gravity_comp export`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
targets:
  c         one C99 header and source in the folder -o, for a controller without Python
            (docs/realtime.md)
  urdf      the file --urdf with the masses and centres of mass nearest to its own that give the
            gravity torque of the model; Coulomb and viscous friction as <dynamics>
  mjcf      the same for a MuJoCo file, --mjcf
  payload   mass and centre of mass of the last `update --urdf`, as lines for the drives of UR,
            Franka, KUKA, xArm and Kinova; in the frame --flange of --urdf

Inertias about the centres of mass, axes and zero angles stay those of the description. Comments
and layout of the file stay byte for byte.

examples:
  gravity_comp export arm.json --to c -o src/
  gravity_comp export left.json --to c --prefix left -o src/    two arms in one program
  gravity_comp export arm.json --to urdf --urdf robot.urdf -o corrected.urdf
  gravity_comp export arm.json --to mjcf --mjcf scene.xml -o corrected.xml
  gravity_comp export tool.json --to payload --urdf robot.urdf --flange tool0
"""
TARGETS = ('c', 'urdf', 'mjcf', 'payload')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `export`."""
    parser.add_argument('model', metavar='MODEL.json', type=Path, help='model to export')
    parser.add_argument('--to', choices=TARGETS, required=True, help='target, see below')
    parser.add_argument('-o', '--output', metavar='PATH', type=Path,
                        help='folder (c, created if missing) or file (urdf, mjcf) to write')
    parser.add_argument('--prefix', metavar='NAME', default=None,
                        help='c: prefix of all names and files (default: gc)')
    arguments.add_description(parser, 'urdf: description to correct; payload: description with '
                              'the flange')
    parser.add_argument('--mjcf', metavar='FILE.xml', type=Path, default=None,
                        help='mjcf: description to correct')
    parser.add_argument('--flange', metavar='LINK', default=None,
                        help='payload: link of --urdf whose frame the drive uses, such as tool0 '
                        '(default: the link of the last joint)')
    arguments.add_json(parser)
    parser.set_defaults(output_is_folder=True)
