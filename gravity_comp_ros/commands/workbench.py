"""`gravity_comp workbench`: compare, diagnose, add and undo in a browser."""

from __future__ import annotations

import argparse
from dataclasses import replace

from gravity_comp_ros.commands import arguments
from gravity_comp_ros.description.urdf import read_text
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.recordings.storage import open_storage


def run(args: argparse.Namespace) -> int:
    """Serve the page until it is stopped."""
    for bag in args.bags:
        # Report an unreadable bag on the terminal, not on the page.
        with open_storage(bag):
            pass
    # Imported here because other verbs do not require Bokeh.
    from gravity_comp_ros.workbench import store
    from gravity_comp_ros.workbench.serve import serve
    from gravity_comp_ros.workbench.store import Choice, Stage, State
    reading = arguments.read_options(args)
    choice = Choice((), reading.joints or (), args.formulation or FitOptions().formulation,
                    reading, arguments.gate(args))
    if args.urdf is not None:
        read_text(args.urdf)
        # The same default as `fit`: a chain with --urdf.
        choice = replace(choice, urdf=str(args.urdf.resolve()),
                         formulation=args.formulation or 'chain')
    state = State(tuple(args.bags), choice, tuple(map(Stage.of_file, args.model)),
                  None if args.urdf is None else args.urdf.resolve())
    serve(state, None if args.forget else store.folder(), args.host, args.port,
          not args.no_browser)
    return 0
