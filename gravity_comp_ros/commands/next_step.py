"""Complete command lines of the next step, with the user's files and reading options."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import shlex

from gravity_comp_ros.commands import terminal


def command(verb: str, args: argparse.Namespace, *more: str, bags: Sequence[Path] | None = None,
            model: Path | str | None = None) -> str:
    """
    Return `gravity_comp VERB BAG... --model MODEL` with the reading options of this call.

    :param more: further arguments, unchanged.
    :param bags: recordings; default: those of this call.
    :param model: the model, if the verb takes one; it determines the joints, so --joints is
        omitted.
    """
    words = ['gravity_comp', verb, *map(str, args.bags if bags is None else bags)]
    if model is not None:
        words += ['--model', str(model)]
    return shlex.join([*words, *reading_words(args, joints=model is None), *more])


def new_model() -> str:
    """Return an unused file name for a model."""
    return new_name('arm', 'json')


def new_name(stem: str, ending: str) -> str:
    """Return an unused file name: `stem.ending`, or with a number from 2."""
    names = [f'{stem}.{ending}', *(f'{stem}_{n}.{ending}' for n in range(2, 100))]
    return next((name for name in names if not Path(name).exists()), names[0])


def reading_words(args: argparse.Namespace, joints: bool) -> list[str]:
    """Return the given options of `arguments.add_reading`, --joints only if `joints` is set."""
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
    """Show the next step: its purpose, and its commands, one per line."""
    terminal.show(f'[bold]next step[/bold]: {terminal.safe(text)}')
    for line in commands:
        terminal.show_command(line)
