"""`gravity_comp completion`: print a shell completion script."""

from __future__ import annotations

import argparse
import importlib

from gravity_comp_ros.commands.outputs import INPUTS, OUTPUTS
from gravity_comp_ros.commands.verbs import VERBS


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    import shtab
    print(shtab.complete(full_parser(), args.shell))
    return 0


def full_parser() -> argparse.ArgumentParser:
    """Return one parser with all verbs, for the completion script only."""
    import shtab
    root = argparse.ArgumentParser(prog='gravity_comp', description='learn gravity torques')
    verbs = root.add_subparsers(dest='verb')
    for verb, text in VERBS.items():
        parser = verbs.add_parser(verb, help=text, allow_abbrev=False)
        importlib.import_module(f'gravity_comp_ros.commands.usage.{verb}').add_arguments(parser)
        for action in parser._actions:
            if action.dest in {**INPUTS, **OUTPUTS}:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    return root
