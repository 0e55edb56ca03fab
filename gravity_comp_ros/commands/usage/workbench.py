"""Arguments of `gravity_comp workbench`."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp workbench run1.mcap run2.mcap
  gravity_comp workbench run1.mcap --model arm.json --model before.json     compare two models
  gravity_comp workbench run1.mcap --no-browser --port 5010

The page is served to this machine only, unless --host is given. Sessions are saved continuously
(~/.local/state/gravity_comp/workbench) and can be resumed; --forget saves none. Stop the server
with Ctrl-C.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `workbench`."""
    arguments.add_bags(parser)
    parser.add_argument('--model', metavar='MODEL.json', type=Path, action='append', default=[],
                        help='initial model, written by `fit`; further models for comparison '
                        '(default: a model is fitted)')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS,
                        default=None,
                        help='formulation of the first fit (default: auto; chain with --urdf)')
    parser.add_argument('--host', default='127.0.0.1',
                        help='address to serve on; other machines can then reach it (default: '
                        '%(default)s)')
    parser.add_argument('--port', type=_port, default=5006,
                        help='0 for any free port (default: %(default)s)')
    parser.add_argument('--no-browser', action='store_true', help='do not open a browser window')
    parser.add_argument('--forget', action='store_true',
                        help='save no session on disk, and list none')
    gate = parser.add_argument_group('samples for the fit and the errors of gravity')
    gate.add_argument('--max-speed', metavar='RAD/S', type=arguments.positive, default=None,
                      help='maximum joint speed of a sample')
    gate.add_argument('--all-samples', action='store_true',
                      help='use every sample, fast or slow')
    arguments.add_drawn_arm(parser, 'robot description for the drawing of the arm and the '
                            'joint axes of fitted models')
    arguments.add_reading(parser)


def _port(text: str) -> int:
    port = int(text) if text.isdecimal() else -1
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f'{text!r} is not a port (0 to 65535)')
    return port
