"""Arguments of `gravity_comp export`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
targets:
  c         one C99 header and source in the folder -o, for a controller without Python
            (docs/realtime.md)

examples:
  gravity_comp export arm.json --to c -o src/
  gravity_comp export left.json --to c --prefix left -o src/    two arms in one program
"""
TARGETS = ('c',)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `export`."""
    parser.add_argument('model', metavar='MODEL.json', type=Path, help='model to export')
    parser.add_argument('--to', choices=TARGETS, required=True, help='target, see below')
    parser.add_argument('-o', '--output', metavar='PATH', type=Path,
                        help='folder (c) to write; created if missing')
    parser.add_argument('--prefix', metavar='NAME', default='gc',
                        help='c: prefix of all names and files (default: %(default)s)')
    arguments.add_json(parser)
    parser.set_defaults(output_is_folder=True)
