"""
Print a shell completion script for verbs, options and files.

For example:
  gravity_comp completion bash > ~/.local/share/bash-completion/completions/gravity_comp
  gravity_comp completion zsh > ~/.zfunc/_gravity_comp        with ~/.zfunc in fpath

The script lists the options of this release: write it again after an upgrade. Completion does not
start Python.
"""

from __future__ import annotations

import argparse
from importlib import import_module

from gravity_comp_ros.commands import summary, terminal, VERBS
import shtab


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `completion`."""
    parser.add_argument('shell', choices=('bash', 'zsh', 'tcsh'), help='target shell')


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    root = argparse.ArgumentParser(prog='gravity_comp', description='learn gravity torques')
    verbs = root.add_subparsers(dest='verb')
    for verb in VERBS:
        parser = verbs.add_parser(verb, help=summary(verb), allow_abbrev=False)
        try:
            import_module(f'gravity_comp_ros.commands.{verb}').add_arguments(parser)
        except ImportError as missing:
            terminal.warn(f'the options of {verb} are not completed: {missing}')
        for action in parser._actions:
            if action.nargs != 0 and not action.choices:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(root, args.shell))
    return 0
