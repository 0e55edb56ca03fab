"""
Compare, diagnose, add effects and undo, in a browser.

For example:
  gravity_comp workbench run1.mcap run2.mcap
  gravity_comp workbench run1.mcap --model arm.json --model before.json     compare two models
  gravity_comp workbench run1.mcap --no-browser --port 5010

The page is served to this machine only, unless --host is given. Save the model before you stop the
server with Ctrl-C: `--model arm.json` continues from it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.commands import arguments
from gravity_comp_ros.description.robot_tree import read_text
from gravity_comp_ros.models.gravity_model import CHOICES
from gravity_comp_ros.recordings.storage import open_storage


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `workbench`."""
    parser.add_argument('--model', metavar='MODEL.json', type=Path, action='append', default=[],
                        help='initial model, written by `fit`; further models for comparison '
                        '(default: a model is fitted)')
    parser.add_argument('--formulation', choices=CHOICES,
                        help='formulation of the first fit (default: auto; chain with --urdf)')
    parser.add_argument('--host', default='127.0.0.1',
                        help='address to serve on; other machines can then reach it (default: '
                        '%(default)s)')
    parser.add_argument('--port', default=5006, type=arguments.number(
        int, 'a port (0 to 65535)', lambda value: 0 <= value <= 65535),
                        help='0 for any free port (default: %(default)s)')
    parser.add_argument('--no-browser', action='store_true', help='do not open a browser window')
    arguments.add_gate(parser, 'samples for the fit and the errors of gravity')
    arguments.add_urdf(parser, f'{arguments.DRAWN}; also the joint axes of fitted models',
                       fixed=False)
    arguments.add_bags(parser)
    arguments.add_reading(parser)


def run(args: argparse.Namespace) -> int:
    """Serve the page until it is stopped."""
    for bag in args.bags:
        # Report an unreadable bag on the terminal, not on the page.
        with open_storage(bag):
            pass
    # Imported here because other verbs do not require Bokeh.
    from gravity_comp_ros.workbench.jobs import new_worker
    from gravity_comp_ros.workbench.serve import serve
    from gravity_comp_ros.workbench.session import Session
    from gravity_comp_ros.workbench.stages import Choice, Stage
    reading = arguments.read_options(args)
    choice = Choice((), reading.joints or (), args.formulation or CHOICES[0],
                    reading, arguments.gate(args))
    if args.urdf is not None:
        read_text(args.urdf)
        # The same default as `fit`: a chain with --urdf.
        choice = replace(choice, urdf=args.urdf.resolve(),
                         formulation=args.formulation or 'chain')
    given = tuple(map(Stage.of_file, args.model))
    session = Session(tuple(args.bags), choice, given, new_worker())
    serve(session, args.host, args.port, not args.no_browser)
    return 0
