"""
One step of the loop each, with the history and provenance that belong to it.

These take and return `GravityModel`; `gravity_comp_ros.fit` and its like wrap them for people,
the commands and services call them as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from gravity_comp_ros.api.axes import KnownAxes
from gravity_comp_ros.api.provenance import held_out_blocks, merged_bags, now
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.data.holdout import HoldoutOptions, within
from gravity_comp_ros.data.runs import recorded_time
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.predict import effect_torque, rows_of
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.estimation.fast_motion import fit_gravity
from gravity_comp_ros.estimation.fit import FitOptions, FitResult
from gravity_comp_ros.estimation.fit_with_effects import fit_with_effects
from gravity_comp_ros.estimation.refit import refit, RefitOptions
from gravity_comp_ros.estimation.refit_result import Refit
from gravity_comp_ros.estimation.regression import recorded_accelerations
from gravity_comp_ros.estimation.subset_stability import instability
from gravity_comp_ros.estimation.update import update, UpdateResult
from gravity_comp_ros.evaluation.compare import compare, Comparison
from gravity_comp_ros.models.gravity_model import GravityModel, UPDATED
from gravity_comp_ros.models.history import with_step
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np

# What was held out of a fit stays so with its margins, s.
_GUARD = HoldoutOptions().guard
PAYLOAD = 'payload'
# Fewer slow samples than this are few poses.
FEW_SLOW = 100
# A recording that lasts longer than this, in s, has settled its model.
SETTLES = 90.0


def fit_model(recording: Recording, options: FitOptions = FitOptions(),
              effects: Sequence[str] = (), speeds: RefitOptions = RefitOptions(),
              progress: Progress | None = None) -> tuple[FitResult, Refit | None]:
    """
    Learn gravity from the slow samples, and effects beside it if some are named.

    Returns the model, with its effects and where it comes from, and how these were found.

    :param effects: `NAME` or `NAME:JOINT`, as `add` takes them.
    :param speeds: which samples the effects are fitted to.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises DataError: if no sample is slow, or an effect cannot be seen.
    :raises ModelMismatchError: if the options know the axes of other joints.
    """
    if options.geometry is not None:
        recording = recording.select_joints(options.geometry.joints)
    recording = with_enough_motion(recording)
    if effects:
        result, joint = _with_effects(recording, options, effects, speeds, progress)
    else:
        slow = recording.slow
        qdd = recorded_accelerations(recording.samples, slow)
        result, joint = fit_gravity(slow, options, progress, qdd), None
        changing = _still_changes(slow, result, options, qdd)
        result = result.with_warning(changing) if changing else result
    if recording.ungated:
        result = result.with_warning(recording.ungated)
    held = recording.holdout
    provenance = {**result.model.provenance, **recording.to_json(),
                  'holdout': held.to_json(recording.reports) if held else None}
    return replace(result, model=replace(result.model, provenance=provenance)), joint


def _still_changes(samples: JointSamples, result: FitResult, options: FitOptions,
                   qdd: FloatArray | None) -> str:
    """Return what a short recording has not settled, in words."""
    if recorded_time(samples) > SETTLES:
        return ''
    axes = None if result.model.geometry is None else options.geometry
    how = replace(options, formulation=result.model.formulation, geometry=axes)
    noise = np.array([result.report.noise[joint] for joint in result.model.joints])

    def fit_again(early: JointSamples) -> GravityModel:
        known = None if qdd is None else qdd[rows_of(samples, early)]
        return fit_gravity(early, how, qdd=known).model

    found = instability(result.model, samples, noise, fit_again)
    return '' if found is None else f'{found}. Record more motion'


def with_enough_motion(recording: Recording) -> Recording:
    """
    Return the recording, ungated if too little of it is slow.

    Few slow samples of a fast recording lie in few poses, and a model of them is wrong in all
    others. Friction and inertia are fitted beside gravity, so that fast samples serve as well. A
    gate that somebody has set is left as it is.

    :raises DataError: if there are no samples at all.
    """
    if recording.gate != GateOptions() or recording.gated_before is not None:
        return recording
    try:
        n_slow = recording.slow.n_samples
    except DataError:
        n_slow = 0
    n = recording.samples.n_samples
    if n_slow >= FEW_SLOW or n < 2 * FEW_SLOW:
        return recording
    return replace(recording, gate=None, ungated=(
        f'only {n_slow} of {n} samples are slow: all are fitted, with inertia and friction beside '
        f'gravity'))


def _with_effects(recording: Recording, options: FitOptions, effects: Sequence[str],
                  speeds: RefitOptions, progress: Progress | None) -> tuple[FitResult, Refit]:
    wanted = requests(effects, recording.joints)
    both = fit_with_effects(recording.samples, recording.slow, wanted, options, speeds,
                            recording.use, progress)
    model = with_step(both.joint.model, both.gravity, both.joint.added, now(),
                      *both.joint.by_joint())
    report = replace(both.fit.report, rmse=dict(zip(model.joints, model.noise.tolist())))
    return FitResult(model, report, both.fit.converged), both.joint


def add_to_model(model: GravityModel, recording: Recording, effects: Sequence[str],
                 speeds: RefitOptions = RefitOptions(),
                 progress: Progress | None = None) -> Refit:
    """
    Add effects to a model and refit it as a whole; the old model goes into its history.

    What was held out of the fit of the model is not fitted here either.

    :param effects: `NAME` or `NAME:JOINT`; none at all only tells the held-out error.
    :raises DataError: if an effect is there already or cannot be seen, or samples are too few.
    :raises OptionError: if an effect or joint is unknown, or asked for twice.
    :raises ModelMismatchError: if the recording lacks a joint of the model.
    """
    recording = recording.select_joints(model.joints)
    wanted = requests(effects, model.joints)
    result = refit(recording.samples, model, wanted, speeds, not_held_out(model, recording),
                   progress)
    changed = with_step(result.model, model, result.added, now(), *result.by_joint())
    provenance = {**model.provenance, 'bags': merged_bags(model, recording.reports)}
    return replace(result, model=replace(changed, provenance=provenance))


def not_held_out(model: GravityModel, recording: Recording) -> BoolArray:
    """Return the usable samples (M,) without what was held out of the fit, margins included."""
    blocks = held_out_blocks(model, recording.reports, _GUARD)
    return recording.usable & ~within(recording.samples, blocks)


def update_model(model: GravityModel, recording: Recording,
                 geometry: Geometry | None = None) -> UpdateResult:
    """
    Learn what a new payload changed; the effects of the model stay as they are.

    :param recording: the arm with its new payload and nothing else.
    :param geometry: where the axes of the arm are; with it mass and centre of mass are found.
    :raises FitError: if there are too few slow samples.
    :raises DataError: if no sample is slow.
    :raises ModelMismatchError: if the recording lacks a joint, or the model has no energy.
    """
    recording = recording.select_joints(model.joints)
    gravity = _gravity_alone(model, recording)
    qdd = None if geometry is None else recorded_accelerations(recording.samples, gravity)
    result = update(model, gravity, geometry=geometry, qdd=qdd)
    *before, last = result.model.provenance['updates']
    bags = [report.to_json() for report in recording.reports]
    provenance: dict[str, Any] = {
        **result.model.provenance, 'bags': merged_bags(model, recording.reports),
        'updates': [*before, {'when': now(), 'bags': bags, **last}]}
    changed = with_step(replace(result.model, provenance=provenance), model, (PAYLOAD,), now(),
                        result.report.rmse_before, result.report.rmse, UPDATED)
    return replace(result, model=changed)


def update_on_axes(model: GravityModel, recording: Recording,
                   axes: KnownAxes) -> tuple[UpdateResult, KnownAxes]:
    """
    Return the update, and the axes that it used: a recording's own only if they fit.

    :raises GravityCompError: as `update_model`.
    """
    try:
        return update_model(model, recording, axes.geometry), axes
    except ModelMismatchError as problem:
        if axes.geometry is None or axes.asked:
            raise
        unused = KnownAxes(problem=f'robot description not used: {problem}')
        return update_model(model, recording), unused


def _gravity_alone(model: GravityModel, recording: Recording) -> JointSamples:
    """Return the slow samples without the torque of the model's effects."""
    slow = recording.slow
    if not model.applied.effects:
        return slow
    torque = effect_torque(model, recording.samples)[rows_of(recording.samples, slow)]
    return replace(slow, tau=slow.tau - torque)


def compare_model(model: GravityModel, recording: Recording,
                  predicted: FloatArray | None = None) -> Comparison:
    """
    Compare a model, with its effects, with the measured torques of the slow samples.

    :param predicted: what the model predicts of all samples (M, N) in N·m, if that is known.
    :raises DataError: if no sample is slow.
    :raises ModelMismatchError: if the recording lacks a joint of the model.
    """
    recording = recording.select_joints(model.joints)
    return compare(model, recording.slow, recording.samples, predicted)
