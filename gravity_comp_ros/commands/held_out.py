"""--holdout: what `fit --holdout` kept aside, for the verbs that come after it."""

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


def required(args: argparse.Namespace, model: GravityModel) -> None:
    """
    Check that something was held out of the fit of a model, if --holdout is given.

    :raises OptionError: if nothing was.
    """
    if args.holdout and not (model.provenance.get('holdout') or {}).get('blocks'):
        raise OptionError(f'nothing was held out when {args.model} was fitted: fit it with '
                          '--holdout')


def of_all_samples(model: GravityModel) -> bool:
    """Return whether a model was fitted to fast samples as well."""
    return bool((model.provenance.get('gate') or {}).get('all_samples'))


def without(model: GravityModel, recording: Recording) -> Recording:
    """Return a recording without what was held out of the fit of a model."""
    if not held_out_blocks(model, recording.reports):
        return recording
    return replace(recording, use=not_held_out(model, recording))


@dataclass(frozen=True)
class HeldOutError:
    """A joint's RMSE in N·m of two models, and the standard deviation of its torque, N·m."""

    rmse_before: float
    rmse_after: float
    torque_std: float


def errors(before: GravityModel, after: GravityModel,
           recording: Recording) -> dict[str, HeldOutError]:
    """
    Return the errors of two models by joint, on what was held out of the fit of the first.

    :raises DataError: if nothing of these recordings was held out.
    """
    use = within(recording.samples, held_out_blocks(before, recording.reports))
    if not use.any():
        raise DataError('the model was fitted to all of these bags: nothing of them was held out')
    gate = None if of_all_samples(before) else recording.gate
    part = replace(recording, use=use, gate=gate)
    old, new = (compare_model(model, part).joints for model in (before, after))
    return {name: HeldOutError(old[name].rmse, new[name].rmse, new[name].torque_std)
            for name in old}


def table(found: dict[str, HeldOutError]) -> ScreenTable:
    """Return the errors on what was held out of the fit, before and after."""
    rows = [(name, f'{e.rmse_before:.4f}', f'{e.rmse_after:.4f}',
             *(percent(rmse / e.torque_std if e.torque_std else None)
               for rmse in (e.rmse_before, e.rmse_after))) for name, e in found.items()]
    return terminal.table(
        'error on what `fit --holdout` held out: N·m, and share of the standard deviation of the '
        'torque', ['joint', 'before', 'after', 'before', 'after'], rows)
