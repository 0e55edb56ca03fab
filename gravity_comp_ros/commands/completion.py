"""`gravity_comp completion`: print a shell completion script."""

from __future__ import annotations

import argparse
from pathlib import Path
import re

from gravity_comp_ros.commands.arguments import recording
from gravity_comp_ros.commands.usage import VERBS
import shtab

# Metavars of options that name a file.
_FILES = re.compile(r'\.\w|FILE|MOTION')


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    root = argparse.ArgumentParser(prog='gravity_comp', description='learn gravity torques')
    verbs = root.add_subparsers(dest='verb')
    for name, verb in VERBS.items():
        parser = verbs.add_parser(name, help=verb.text, allow_abbrev=False)
        verb.add_arguments(parser)
        for action in parser._actions:
            if action.type in (Path, recording) or _FILES.search(str(action.metavar)):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(root, args.shell))
    return 0
