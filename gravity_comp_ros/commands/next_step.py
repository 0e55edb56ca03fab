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
    line = ['gravity_comp', verb, *map(str, args.bags if bags is None else bags)]
    if model is not None:
        line += ['--model', str(model)]
    return shlex.join([*line, *reading_options(args, joints=model is None), *more])


def new_model() -> str:
    """Return an unused file name for a model."""
    return new_name('arm', 'json')


def new_name(stem: str, ending: str) -> str:
    """Return an unused file name: `stem.ending`, or with a number from 2."""
    names = [f'{stem}.{ending}', *(f'{stem}_{n}.{ending}' for n in range(2, 100))]
    return next((name for name in names if not Path(name).exists()), names[0])


def reading_options(args: argparse.Namespace, joints: bool) -> list[str]:
    """Return the given options of `arguments.add_reading`, --joints only if `joints` is set."""
    options = []
    if args.topic:
        options += ['--topic', args.topic]
    if joints and args.joints:
        options += ['--joints', ','.join(args.joints)]
    scales = [f'{joint}={scale:g}' for part in args.effort_scale for joint, scale in part.items()]
    if scales:
        options += ['--effort-scale', ','.join(scales)]
    if args.effort_unit != 'Nm':
        options += ['--effort-unit', args.effort_unit]
    if args.rename:
        options += ['--rename', ','.join(f'{old}={new}' for old, new in args.rename)]
    if args.position_unit != 'rad':
        options += ['--position-unit', args.position_unit]
    if args.accept:
        options += ['--accept', ','.join(args.accept)]
    if args.reverse:
        options += ['--reverse', ','.join(args.reverse)]
    zeros = [f'{joint}={zero:g}' for part in args.zero for joint, zero in part.items()]
    options += ['--zero', ','.join(zeros)] if zeros else []
    options += ['--differentiate'] * args.differentiate
    return options


def show(text: str, *commands: str) -> None:
    """Show the next step: its purpose, and its commands, one per line."""
    terminal.show(f'[bold]next step[/bold]: {terminal.safe(text)}')
    for line in commands:
        terminal.show_command(line)
