"""The command that follows, whole: the user's own files, and what says how they are read."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import shlex

from gravity_comp_ros.commands import terminal


def command(verb: str, args: argparse.Namespace, *more: str, bags: Sequence[Path] | None = None,
            model: Path | str | None = None) -> str:
    """
    Return `gravity_comp VERB BAG... --model MODEL`, read as this call reads, ready to paste.

    :param more: further words, as they are.
    :param bags: recordings; those of this call if not given.
    :param model: the model, if the verb takes one; it says then which joints there are.
    """
    words = ['gravity_comp', verb, *map(str, args.bags if bags is None else bags)]
    if model is not None:
        words += ['--model', str(model)]
    return shlex.join([*words, *reading_words(args, joints=model is None), *more])


def new_model() -> str:
    """Return a name for a model that is no file yet."""
    return new_name('arm', 'json')


def new_name(stem: str, ending: str) -> str:
    """Return a name that is no file yet: `stem.ending`, or with a number from 2."""
    names = [f'{stem}.{ending}', *(f'{stem}_{n}.{ending}' for n in range(2, 100))]
    return next((name for name in names if not Path(name).exists()), names[0])


def reading_words(args: argparse.Namespace, joints: bool) -> list[str]:
    """Return the options of `arguments.add_reading` that were given; `joints` unless a model."""
    words = []
    if args.topic:
        words += ['--topic', args.topic]
    if joints and args.joints:
        words += ['--joints', ','.join(args.joints)]
    scales = [f'{joint}={scale:g}' for part in args.effort_scale for joint, scale in part.items()]
    if scales:
        words += ['--effort-scale', ','.join(scales)]
    if args.effort_unit != 'Nm':
        words += ['--effort-unit', args.effort_unit]
    if args.rename:
        words += ['--rename', ','.join(f'{old}={new}' for old, new in args.rename)]
    words += ['--degrees'] * args.degrees + ['--differentiate'] * args.differentiate
    return words


def show(text: str, *commands: str) -> None:
    """Show what comes next: why, and the commands, each on a line of its own."""
    terminal.show(f'[bold]next step[/bold]: {terminal.safe(text)}')
    for line in commands:
        terminal.show_command(line)
