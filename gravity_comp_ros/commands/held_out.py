"""Data held out by `fit --holdout`, for --holdout of the other verbs."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

from gravity_comp_ros.api.provenance import held_out_blocks
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import compare_model, not_held_out
from gravity_comp_ros.commands import terminal
from gravity_comp_ros.commands.screen_table import ScreenTable
from gravity_comp_ros.data.holdout import within
from gravity_comp_ros.diagnosis.wording import percent
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.models.gravity_model import GravityModel


NOTHING_HELD_OUT = 'the model was fitted to all of these bags: none of their data was held out'


def required(args: argparse.Namespace, model: GravityModel) -> None:
    """
    Check that the fit of a model held out data, if --holdout is given.

    :raises OptionError: if it did not.
    """
    if args.holdout and not (model.provenance.get('holdout') or {}).get('blocks'):
        raise OptionError(f'{args.model} was fitted without --holdout: fit it with --holdout')


def of_all_samples(model: GravityModel) -> bool:
    """Return whether a model was fitted to slow and fast samples."""
    return bool((model.provenance.get('gate') or {}).get('all_samples'))


def without(model: GravityModel, recording: Recording) -> Recording:
    """Return a recording without the data held out of the fit of a model."""
    if not held_out_blocks(model, recording.reports):
        return recording
    return replace(recording, use=not_held_out(model, recording))


@dataclass(frozen=True)
class HeldOutError:
    """RMSE of two models and standard deviation of the torque of one joint, all in N·m."""

    rmse_before: float
    rmse_after: float
    torque_std: float


def errors(before: GravityModel, after: GravityModel,
           recording: Recording) -> dict[str, HeldOutError]:
    """
    Return the errors of two models by joint, on the data held out of the fit of the first.

    :raises DataError: if no data of these recordings was held out.
    """
    use = within(recording.samples, held_out_blocks(before, recording.reports))
    if not use.any():
        raise DataError(NOTHING_HELD_OUT)
    gate = None if of_all_samples(before) else recording.gate
    part = replace(recording, use=use, gate=gate)
    old, new = (compare_model(model, part).joints for model in (before, after))
    return {name: HeldOutError(old[name].rmse, new[name].rmse, new[name].torque_std)
            for name in old}


def table(errors: dict[str, HeldOutError]) -> ScreenTable:
    """Return the table of errors on the held-out data, before and after."""
    rows = [(name, f'{e.rmse_before:.4f}', f'{e.rmse_after:.4f}',
             *(percent(rmse / e.torque_std if e.torque_std else None)
               for rmse in (e.rmse_before, e.rmse_after))) for name, e in errors.items()]
    return terminal.table(
        'error on the data held out by `fit --holdout`: N·m, and share of the standard deviation '
        'of the torque', ['joint', 'before', 'after', 'before', 'after'], rows)
