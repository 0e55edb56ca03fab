"""Complete command lines of the next step, with the user's files and options."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import shlex

from gravity_comp_ros.commands import terminal
from gravity_comp_ros.commands.arguments import read_options, verb_parser
from gravity_comp_ros.recordings.read_options import option_words

# Options of description and gate; no verb with another meaning of one prints commands with it.
_SHARED = ('urdf', 'fixed', 'all_samples', 'max_speed', 'rate')


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
    options = {action.dest: action for action in verb_parser(verb)._actions}
    given = {name: getattr(args, name, None) for name in _SHARED if name in options}
    if given.get('urdf') == 'none' and options['urdf'].type is Path:
        del given['urdf']
    return shlex.join([*line, *read_options(args).words(joints=model is None),
                       *option_words(given), *more])


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
