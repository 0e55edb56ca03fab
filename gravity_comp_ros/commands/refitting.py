"""Output of `add` and `fit --effects` for a joint refit of gravity and effects."""

from __future__ import annotations

import argparse
from pathlib import Path

from gravity_comp_ros.api.provenance import now
from gravity_comp_ros.api.results import effect_numbers
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.commands.screen_table import ScreenTable
from gravity_comp_ros.diagnosis.wording import percent
from gravity_comp_ros.display import change
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.estimation.refit import Refit, RefitOptions
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.history import undone
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.printable import counted


def speeds(args: argparse.Namespace) -> RefitOptions:
    """
    Return the refit options of --all-samples and --max-speed.

    :raises OptionError: if both are given.
    """
    if args.all_samples and args.max_speed is not None:
        raise OptionError('give --all-samples or --max-speed, not both')
    return RefitOptions.chosen(args.all_samples, args.max_speed)


def undo(args: argparse.Namespace, model: GravityModel, output: Path) -> GravityModel:
    """
    Return the model before its last change; write it unless this is a dry run.

    :raises OptionError: if the model has no change to undo.
    """
    try:
        back = undone(model, now())
    except DataError as problem:
        raise OptionError(f'{args.model}: {problem}') from problem
    if not args.dry_run:
        save_model(output, back)
    return back


def fitted_sentence(result: Refit) -> str:
    """Return a sentence with the number of fitted samples."""
    kind = '' if result.all_speeds else 'slow '
    hint = '' if result.all_speeds else ' (--all-samples includes fast samples)'
    return f'gravity and effects are fitted to {counted(result.n_samples, kind + "sample")}{hint}'


def error_table(result: Refit) -> ScreenTable:
    """Return the table of held-out errors by joint, before and after."""
    rows = [(name, f'{e.before:.4f}', f'{e.after:.4f}', percent(e.nrmse_before),
             percent(e.nrmse_after), change(e.before, e.after))
            for name, e in result.errors.items()]
    return terminal.table('held-out error: N·m, and share of the torque range',
                          ['joint', 'before', 'after', 'before', 'after', 'change'], rows)


def effect_lines(result: Refit) -> list[str]:
    """Return lines of markup on added and omitted effects."""
    lines = [f'added [bold]{terminal.safe(effect.target)}[/bold]: '
             f'{terminal.safe(numbers(effect))}'
             for effect in result.model.applied.effects if effect.target in result.added]
    lines += [terminal.safe(f'omitted {name}: {why}') for name, why in result.skipped.items()]
    return lines


def numbers(effect: AppliedEffect) -> str:
    """Return an applied effect's coefficients and nonlinear parameters in one line."""
    return ', '.join([*effect_numbers(effect), *(
        f'{name} {x:.3g}' for name, x in effect.setting.items() if name != 'clock')])


def warnings(result: Refit) -> list[str]:
    """Return warnings on a refit, with the command that undoes it."""
    lines = result.warnings()
    if not result.helps:
        lines[-1] += '; `gravity_comp add --undo` removes the addition'
    return lines
