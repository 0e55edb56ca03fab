"""
Steps of the loop on `GravityModel`, with provenance and history.

The commands and ROS services call these functions. `gravity_comp_ros.fit` and the other public
functions wrap them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from gravity_comp_ros.api.axes import KnownAxes
from gravity_comp_ros.api.provenance import held_out_blocks, merged_bags, now
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.data.gate import apply_gate, GateOptions
from gravity_comp_ros.data.holdout import HoldoutOptions, within
from gravity_comp_ros.data.runs import recorded_time, rows_of
from gravity_comp_ros.data.samples import BoolArray, JointSamples
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit, fit_again, FitResult
from gravity_comp_ros.estimation.refit import Refit, refit, RefitOptions
from gravity_comp_ros.estimation.subset_stability import convergence_objection
from gravity_comp_ros.estimation.update import update, UpdateResult
from gravity_comp_ros.evaluation.compare import compare, Comparison
from gravity_comp_ros.models.gravity_model import GravityModel, UPDATED
from gravity_comp_ros.models.history import with_step
import numpy as np

# Time around held-out blocks that is not fitted either, s.
_GUARD = HoldoutOptions().guard
PAYLOAD = 'payload'
# Minimum number of slow samples for a fit with the default gate.
MIN_SLOW_SAMPLES = 100
# Maximum recorded time, in s, for which the convergence of the model is tested.
_MAX_TESTED_TIME = 90.0


def fit_model(recording: Recording, options: FitOptions = FitOptions(),
              effects: Sequence[str] = (), speeds: RefitOptions = RefitOptions(),
              progress: Progress | None = None) -> tuple[FitResult, Refit | None]:
    """
    Fit gravity to the slow samples, jointly with the named effects.

    Returns the fit with provenance, and the refit of the effects (None without effects).

    :param effects: effects as in `gravity_comp_ros.fit`.
    :param speeds: selection of the samples that the effects are fitted to.
    :raises FitError: if there are too few samples, or no joint moves.
    :raises DataError: if no sample is slow, or an effect is not identifiable.
    :raises ModelMismatchError: if the axes in the options are those of other joints.
    """
    if options.geometry is not None:
        recording = recording.select_joints(options.geometry.joints)
    recording = with_enough_motion(recording)
    if effects:
        result, refitted = _with_effects(recording, options, effects, speeds, progress)
    else:
        result, refitted = fit(recording.samples, options, progress,
                               use=slow_mask(recording)), None
        warning = _convergence_warning(recording.slow, result, options)
        result = result.with_warning(warning) if warning else result
    if recording.ungated:
        result = result.with_warning(recording.ungated)
    holdout = recording.holdout
    provenance = {**result.model.provenance, **recording.to_json(),
                  'holdout': holdout.to_json(recording.reports) if holdout else None}
    return replace(result, model=replace(result.model, provenance=provenance)), refitted


def _convergence_warning(samples: JointSamples, result: FitResult, options: FitOptions) -> str:
    """Return a warning if a fit to part of a short recording gives another model, else ''."""
    if recorded_time(samples) > _MAX_TESTED_TIME:
        return ''
    noise = np.array([result.report.noise[joint] for joint in result.model.joints])

    change = convergence_objection(result.model, samples, noise,
                                   lambda part: fit_again(part, result, options).model)
    return '' if change is None else f'{change}. Record more motion'


def with_enough_motion(recording: Recording) -> Recording:
    """
    Return the recording, without its gate if it has too few slow samples.

    The few slow samples of a fast recording cover few poses, and a model fitted to them does not
    generalise. Friction and inertia are nuisance terms of the fit, so that fast samples can be
    used. Only the default gate is removed.

    :raises DataError: if there are no samples.
    """
    if recording.gate != GateOptions():
        return recording
    try:
        n_slow = recording.slow.n_samples
    except DataError:
        n_slow = 0
    n = recording.samples.n_samples
    if n_slow >= MIN_SLOW_SAMPLES or n < 2 * MIN_SLOW_SAMPLES:
        return recording
    return replace(recording, gate=None, ungated=(
        f'the slow-motion gate keeps only {n_slow} of {n} samples: all are fitted, with inertia '
        f'and friction as nuisance terms'))


def _with_effects(recording: Recording, options: FitOptions, effects: Sequence[str],
                  speeds: RefitOptions, progress: Progress | None
                  ) -> tuple[FitResult, Refit | None]:
    """Return a fit that predicts effects, those that it predicts with gravity among them."""
    first = fit(recording.samples, options, progress, use=slow_mask(recording))
    missing = [request for request in requests(effects, recording.joints)
               if not first.model.applied.has(request.effect.name, request.joint)]
    if not missing:
        return first, None
    joint = refit(recording.samples, first.model, missing, speeds, recording.use, progress)
    model = with_step(joint.model, first.model, joint.added, now(), *joint.by_joint())
    report = replace(first.report, rmse=dict(zip(model.joints, model.noise.tolist())))
    return replace(first, model=model, report=report), joint


def slow_mask(recording: Recording) -> BoolArray:
    """
    Return the mask (M,) of the usable samples that are slow; all usable ones without a gate.

    The rate of the gate does not matter: rows of the regression are means over time.
    """
    if recording.gate is None:
        return recording.usable
    gate = replace(recording.gate, rate_hz=None)
    kept = apply_gate(recording.samples, gate).samples
    mask = np.zeros(len(recording.samples), dtype=bool)
    mask[rows_of(recording.samples, kept)] = True
    return mask & recording.usable


def add_to_model(model: GravityModel, recording: Recording, effects: Sequence[str],
                 speeds: RefitOptions = RefitOptions(),
                 progress: Progress | None = None) -> Refit:
    """
    Add effects to a model and refit gravity and effects; the history keeps the old model.

    Samples held out of the original fit are not fitted.

    :param effects: effects as in `gravity_comp_ros.fit`; without any, only the held-out error is
        computed.
    :raises DataError: if an effect is in the model already or is not identifiable, or if there
        are too few samples.
    :raises OptionError: if an effect or joint is unknown, or named twice.
    :raises ModelMismatchError: if a joint of the model is missing in the recording.
    """
    recording = recording.select_joints(model.joints)
    result = refit(recording.samples, model, requests(effects, model.joints), speeds,
                   not_held_out(model, recording), progress)
    changed = with_step(result.model, model, result.added, now(), *result.by_joint())
    provenance = {**model.provenance, 'bags': merged_bags(model, recording.reports)}
    return replace(result, model=replace(changed, provenance=provenance))


def not_held_out(model: GravityModel, recording: Recording) -> BoolArray:
    """Return the mask (M,) of usable samples outside the guarded blocks held out of the fit."""
    blocks = held_out_blocks(model, recording.reports, _GUARD)
    return recording.usable & ~within(recording.samples, blocks)


def update_model(model: GravityModel, recording: Recording,
                 axes: KnownAxes) -> tuple[UpdateResult, KnownAxes]:
    """
    Update the gravity model after a payload change; its effects stay unchanged.

    Returns the update and the axes used; axes from a recording are used only if they match.

    :param recording: motion with the new payload only.
    :param axes: joint axes of the arm; with them, mass and centre of mass are identified.
    :raises FitError: if there are too few slow samples.
    :raises DataError: if no sample is slow.
    :raises ModelMismatchError: if a joint of the model is missing in the recording, the model has
        no potential energy, or the user named the description of another arm.
    """
    recording = recording.select_joints(model.joints)
    gravity = _gravity_alone(model, recording)
    try:
        result = update(model, gravity, geometry=axes.geometry)
    except ModelMismatchError as problem:
        if axes.geometry is None or axes.from_user:
            raise
        axes = KnownAxes(problem=f'robot description not used: {problem}')
        result = update(model, gravity)
    *before, last = result.model.provenance['updates']
    bags = [report.to_json() for report in recording.reports]
    provenance: dict[str, Any] = {
        **result.model.provenance, 'bags': merged_bags(model, recording.reports),
        'updates': [*before, {'when': now(), 'bags': bags, **last}]}
    changed = with_step(replace(result.model, provenance=provenance), model, (PAYLOAD,), now(),
                        result.report.rmse_before, result.report.rmse, UPDATED)
    return replace(result, model=changed), axes


def _gravity_alone(model: GravityModel, recording: Recording) -> JointSamples:
    """Return the slow samples, minus the torque of the model's effects."""
    slow = recording.slow
    if not model.applied.effects:
        return slow
    torque = effect_torque(model, recording.samples)[rows_of(recording.samples, slow)]
    return replace(slow, tau=slow.tau - torque)


def compare_model(model: GravityModel, recording: Recording) -> Comparison:
    """
    Compare gravity and effects of a model with the measured torques of the slow samples.

    :raises DataError: if no sample is slow.
    :raises ModelMismatchError: if a joint of the model is missing in the recording.
    """
    recording = recording.select_joints(model.joints)
    return compare(model, recording.slow, recording.samples)
