"""Complete command lines of the next step, with the user's files and options."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import shlex

from gravity_comp_ros.commands import terminal
from gravity_comp_ros.commands.arguments import read_options, verb_parser
from gravity_comp_ros.recordings.read_options import option_words

# Options of description and gate; the first one of each group belongs to no other.
_SHARED = (('urdf', 'fixed'), ('all_samples', 'max_speed', 'rate'))


def command(verb: str, args: argparse.Namespace, *more: str, bags: Sequence[Path] | None = None,
            model: Path | str | None = None) -> str:
    """
    Return `gravity_comp VERB BAG... --model MODEL` with the options of this call.

    They are those of reading, and the description and the gate if the verb has them.

    :param more: further arguments, unchanged.
    :param bags: recordings; default: those of this call.
    :param model: the model, if the verb takes one; it determines the joints, so --joints is
        omitted.
    """
    line = ['gravity_comp', verb, *map(str, args.bags if bags is None else bags)]
    if model is not None:
        line += ['--model', str(model)]
    return shlex.join([*line, *read_options(args).words(joints=model is None),
                       *_shared_words(verb, args), *more])


def _shared_words(verb: str, args: argparse.Namespace) -> list[str]:
    """Return the description and the gate of this call, if the verb has these options."""
    options = {action.dest: action for action in verb_parser(verb)._actions}
    names = [name for group in _SHARED
             if group[0] in options and hasattr(args, group[0]) for name in group]
    return option_words({
        name: value for name in names if name in options
        and not ((value := getattr(args, name, None)) == 'none' and options[name].type is Path)})


def check_recordings(*paths: Path) -> list[terminal.Line]:
    """Return the next step after recordings are written."""
    return lines(f'check the {"recording" if len(paths) == 1 else "recordings"}',
                 shlex.join(['gravity_comp', 'info', *map(str, paths)]))


def new_name(stem: str = 'arm', ending: str = 'json') -> str:
    """Return an unused file name: `stem.ending`, or with a number from 2."""
    names = [f'{stem}.{ending}', *(f'{stem}_{n}.{ending}' for n in range(2, 100))]
    return next((name for name in names if not Path(name).exists()), names[0])


def lines(text: str, *commands: str) -> list[terminal.Line]:
    """Return the next step: its purpose, and its commands, one per line."""
    return [terminal.styled('bold', 'next step', f': {text}'), *map(terminal.command, commands)]
