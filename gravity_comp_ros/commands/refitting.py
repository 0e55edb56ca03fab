"""Joint refits of gravity and effects: their samples, lines about them, and undo."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import held_out_blocks, not_held_out
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.commands.arguments import gate
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.display import change, percent
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.estimation.refit import HeldOut, Refit
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.history import now, undone
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.printable import counted
from rich.table import Table


def fitted_gate(args: argparse.Namespace, model: GravityModel) -> GateOptions | None:
    """Return the gate of the arguments if they have one, else that of the fit of the model."""
    given = gate(args)
    fitted = model.provenance.get('gate')
    if fitted is None or given != GateOptions() or args.max_speed is not None:
        return given
    return None if fitted['all_samples'] else GateOptions(fitted['max_speed'], fitted['rate_hz'])


def without_held_out(model: GravityModel, recording: Recording) -> Recording:
    """Return a recording without the data held out of the fit of a model."""
    if not held_out_blocks(model, recording.reports):
        return recording
    return replace(recording, use=not_held_out(model, recording))


def errors_table(title: str, errors: Mapping[str, HeldOut]) -> Table:
    """Return the table of errors before and after, and their shares of the size of the torque."""
    rows = [(name, f'{e.before:.4f}', f'{e.after:.4f}', percent(e.nrmse_before),
             percent(e.nrmse_after), change(e.before, e.after)) for name, e in errors.items()]
    return terminal.table(title, ['joint', 'before', 'after', 'before', 'after', 'change'], rows)


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


def lines(result: Refit) -> list[terminal.Line]:
    """Return the size of the fit, the held-out errors, and added and omitted effects."""
    added = {effect.target: ', '.join(filter(None, (
        wording.coefficients(effect.coefficients, 6), wording.settings(effect))))
        for effect in result.model.applied.effects if effect.target in result.added}
    return [
        f'gravity and effects are fitted to {counted(result.n_samples, "sample")}',
        '', errors_table('held-out error: N·m, and share of the torque range', result.errors),
        *(terminal.styled('bold', f'added {name}', f': {numbers}')
          for name, numbers in added.items()),
        *(f'omitted {name}: {why}' for name, why in result.skipped.items())]


def warnings(result: Refit) -> list[str]:
    """Return warnings on a refit, with the command that undoes it."""
    lines = result.warnings()
    if not result.helps:
        lines[-1] += '; `gravity_comp add --undo` removes the addition'
    return lines
