"""Arguments of `gravity_comp completion`."""

from __future__ import annotations

import argparse

EPILOG = """\
examples:
  gravity_comp completion bash > ~/.local/share/bash-completion/completions/gravity_comp
  gravity_comp completion zsh > ~/.zfunc/_gravity_comp        with ~/.zfunc in fpath

The script lists the options of this release: write it again after an upgrade. Completion does not
start Python.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `completion`."""
    parser.add_argument('shell', choices=('bash', 'zsh', 'tcsh'), help='target shell')
