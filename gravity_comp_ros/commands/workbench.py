"""`gravity_comp workbench`: compare, diagnose, add and undo in a browser."""

from __future__ import annotations

import argparse

from gravity_comp_ros.commands import arguments
from gravity_comp_ros.description.urdf import read_text
from gravity_comp_ros.recordings.storage import open_storage


def run(args: argparse.Namespace) -> int:
    """Serve the page until it is stopped."""
    for bag in args.bags:
        # Report an unreadable bag on the terminal, not on the page.
        with open_storage(bag):
            pass
    if args.urdf is not None:
        read_text(args.urdf)
    # Imported here because other verbs do not require Bokeh.
    from gravity_comp_ros.workbench import store
    from gravity_comp_ros.workbench.serve import serve, ServeOptions
    serve(ServeOptions(tuple(args.bags), tuple(args.model), arguments.read_options(args),
                       args.formulation, args.host, args.port, not args.no_browser,
                       args.max_speed, args.all_samples,
                       None if args.forget else store.folder(), args.urdf))
    return 0
