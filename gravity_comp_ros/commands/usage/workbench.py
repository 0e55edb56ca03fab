"""What `gravity_comp workbench` takes."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.commands import arguments

EPILOG = """\
examples:
  gravity_comp workbench run1.mcap run2.mcap
  gravity_comp workbench run1.mcap --model arm.json --model before.json     compare two models
  gravity_comp workbench --live                        follow the node /gravity_comp
  gravity_comp workbench run1.mcap --live arm/gravity_comp --no-browser --port 5010

The page is served to this machine alone unless --host says otherwise. Sessions are kept as they
go (~/.local/state/gravity_comp/workbench) and can be gone on with; --forget keeps none. Stop it
with Ctrl-C.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `workbench`."""
    arguments.add_bags(parser, nargs='*')
    parser.add_argument('--model', metavar='MODEL.json', type=Path, action='append', default=[],
                        help='a model to begin with, as `fit` writes it; further ones to '
                        'compare it with (default: one is fitted)')
    parser.add_argument('--formulation', choices=arguments.FORMULATIONS,
                        default=None,
                        help='of the model that is fitted first (default: auto, with --urdf '
                        'chain)')
    parser.add_argument('--live', metavar='NODE', nargs='?', const='gravity_comp', default=None,
                        help='follow the topics of a running node (default: gravity_comp)')
    parser.add_argument('--host', default='127.0.0.1',
                        help='address to serve on; others can then reach it (default: '
                        '%(default)s)')
    parser.add_argument('--port', type=_port, default=5006,
                        help='0 for any that is free (default: %(default)s)')
    parser.add_argument('--no-browser', action='store_true', help='open no browser window')
    parser.add_argument('--forget', action='store_true',
                        help='keep no session on disk, and list none')
    gate = parser.add_argument_group('samples that gravity is learned and judged on')
    gate.add_argument('--max-speed', metavar='RAD/S', type=arguments.positive, default=None,
                      help='fastest joint speed that a sample may have')
    gate.add_argument('--all-samples', action='store_true',
                      help='use every sample, fast or slow')
    arguments.add_drawn_arm(parser, 'the arm is drawn by this description, and a model that is '
                            'fitted has its axes')
    arguments.add_reading(parser)


def _port(text: str) -> int:
    port = int(text) if text.isdecimal() else -1
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f'{text!r} is no port (0 to 65535)')
    return port
