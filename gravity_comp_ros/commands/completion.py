"""`gravity_comp completion`: print a shell completion script."""

from __future__ import annotations

import argparse

from gravity_comp_ros.commands.outputs import names_file
from gravity_comp_ros.commands.usage import VERBS
import shtab


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    root = argparse.ArgumentParser(prog='gravity_comp', description='learn gravity torques')
    verbs = root.add_subparsers(dest='verb')
    for name, verb in VERBS.items():
        parser = verbs.add_parser(name, help=verb.text, allow_abbrev=False)
        verb.add_arguments(parser)
        for action in parser._actions:
            if names_file(action):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(root, args.shell))
    return 0
