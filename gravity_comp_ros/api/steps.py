"""
Steps of the loop on `GravityModel`, with provenance and history.

Commands, workbench and fleet call these functions. The public ones (`loop`) wrap them, and name
the errors that they raise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TYPE_CHECKING

from gravity_comp_ros.api.axes import ArmOptions, known_arm, KnownArm
from gravity_comp_ros.api.read import arm_facts
from gravity_comp_ros.api.recording import Progress, Recording
from gravity_comp_ros.data.gate import apply_gate, GateOptions
from gravity_comp_ros.data.runs import Block, GUARD, numbers_in, recorded_time, within
from gravity_comp_ros.data.samples import BoolArray, JointSamples
from gravity_comp_ros.description.joint_order import AS_RECORDED, JointOrder, TORQUES
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.effects.registry import requests
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.evaluation.compare import compare, Comparison
from gravity_comp_ros.facts.fact import Fact
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.gravity_model import GravityModel, UPDATED
from gravity_comp_ros.models.history import now, with_step
import numpy as np
if TYPE_CHECKING:
    # Import SciPy, which takes 0.3 s; --help and comparisons do without.
    from gravity_comp_ros.estimation.estimate import FitOptions
    from gravity_comp_ros.estimation.fit import FitResult
    from gravity_comp_ros.estimation.refit import Refit
    from gravity_comp_ros.estimation.update import UpdateResult
    from gravity_comp_ros.recordings.bag import ReadReport

PAYLOAD = 'payload'
# Maximum recorded time, in s, for which the convergence of the model is tested.
_MAX_TESTED_TIME = 90.0


@dataclass(frozen=True)
class Learned:
    """A fit, the `refit` of its effects (None without effects), arm, samples, and `arm_facts`."""

    result: FitResult
    refit: Refit | None
    arm: KnownArm
    recording: Recording
    facts: tuple[Fact, ...]

    @property
    def model(self) -> GravityModel:
        """Return the fitted model."""
        return self.result.model


@dataclass(frozen=True)
class Diagnosed:
    """A diagnosis, the model (None if none was needed), samples, and `arm_facts`."""

    diagnosis: Diagnosis
    model: GravityModel | None
    recording: Recording
    facts: tuple[Fact, ...]


def learn(recording: Recording, options: ArmOptions = ArmOptions(),
          effects: Sequence[str] = (), progress: Progress | None = None,
          arm: KnownArm | None = None) -> Learned:
    """
    Fit gravity, jointly with the named effects.

    If neither description nor names give the joint order, it is identified from the torques.

    :param arm: joint order and axes; None takes them from the recording.
    :raises DataError: if a fact on the joints is refused.
    """
    arm = arm or known_arm(recording, options)
    recording = arm.of(recording)
    facts = arm_facts(recording, arm)
    fit_options = options.to_fit(arm)
    result, refitted = fit_model(recording, fit_options, effects, progress)
    order = None
    if arm.order.source == AS_RECORDED:
        order = order_by_torques(recording, result)
    if order is not None:
        arm = replace(arm, order=order)
        recording = arm.of(recording)
        result, refitted = fit_model(recording, fit_options, effects, progress)
    provenance = {**result.model.provenance, 'description': arm.to_json(),
                  'joint_order': arm.order.source}
    result = replace(result, model=replace(result.model, provenance=provenance))
    if arm.problem:
        result = result.with_warning(arm.problem)
    return Learned(result, refitted, arm, recording, facts)


def fit_model(recording: Recording, options: FitOptions, effects: Sequence[str] = (),
              progress: Progress | None = None) -> tuple[FitResult, Refit | None]:
    """
    Fit gravity to the slow samples, jointly with the named effects, on known axes and joints.

    The refit of the effects is None if the fit of gravity predicts all of them.
    """
    from gravity_comp_ros.estimation.fit import fit
    from gravity_comp_ros.estimation.refit import refit
    if options.geometry is not None:
        recording = recording.select_joints(options.geometry.joints)
    recording = with_enough_motion(recording)
    use = slow_mask(recording)
    result, joint = fit(recording.samples, options, progress, use=use), None
    missing = [request for request in requests(effects, recording.joints)
               if not result.model.applied.has(request.effect.name, request.joint)]
    if missing:
        joint = refit(recording.samples, result.model, missing, use=use, progress=progress)
        model = with_step(joint.model, result.model, joint.added, now(), *joint.by_joint())
        report = replace(result.report, rmse=dict(zip(model.joints, model.noise.tolist())))
        result = replace(result, model=model, report=report)
    change = None if effects else _convergence_objection(recording.slow, result, options)
    for warning in (change and f'{change}. Record more motion', recording.ungated):
        result = result.with_warning(warning) if warning else result
    holdout = recording.holdout
    provenance = {**result.model.provenance, **recording.to_json(),
                  'holdout': holdout.to_json(recording.reports) if holdout else None}
    return replace(result, model=replace(result.model, provenance=provenance)), joint


def _convergence_objection(samples: JointSamples, result: FitResult,
                           options: FitOptions) -> str | None:
    """Return a sentence if a fit to part of a short recording gives another model, else None."""
    from gravity_comp_ros.estimation.fit import fit_again
    from gravity_comp_ros.estimation.subset_stability import convergence_objection
    if recorded_time(samples) > _MAX_TESTED_TIME:
        return None
    noise = np.array([result.report.noise[joint] for joint in result.model.joints])
    return convergence_objection(result.model, samples, noise,
                                 lambda part: fit_again(result, options, part).model)


def order_by_torques(recording: Recording, result: FitResult) -> JointOrder | None:
    """
    Return a joint order with a much smaller residual torque, None if there is none.

    If the residual of the fit is white, no other order is searched.

    :param result: fit in the order of the recording.
    """
    from gravity_comp_ros.estimation.axis_directions import joint_order_from_torques
    if result.report.white:
        return None
    joints = joint_order_from_torques(with_enough_motion(recording).slow)
    return None if joints is None else JointOrder(joints, TORQUES)


def with_enough_motion(recording: Recording) -> Recording:
    """
    Return the recording, without its gate if it has too few slow samples, or less than a fifth.

    The few slow samples of a fast recording cover few poses, and a model fitted to them does not
    generalise; effects of motion have larger intervals. Friction and inertia are nuisance terms
    of the fit, so that fast samples can be used. Only the default gate is removed.
    """
    if recording.gate != GateOptions():
        return recording
    try:
        n_slow, share = recording.slow.n_samples, slow_mask(recording).sum() / len(recording)
    except DataError:
        n_slow, share = 0, 0.0
    n, facts = recording.samples.n_samples, FactOptions()
    if n_slow >= facts.min_samples and share >= facts.min_slow or n < 2 * facts.min_samples:
        return recording
    return replace(recording, gate=None, ungated=(
        f'the slow-motion gate keeps only {n_slow} of {n} samples: all are fitted, with inertia '
        f'and friction as nuisance terms'))


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
    mask[numbers_in(recording.samples, kept)] = True
    return mask & recording.usable


def diagnose_recording(recording: Recording, model: GravityModel | None = None,
                       effects: Sequence[str] | None = None,
                       learning: ArmOptions = ArmOptions(), progress: Progress | None = None,
                       fits: bool = False) -> Diagnosed:
    """
    Identify the effects that a model does not include, from slow and fast samples.

    The diagnosis fits its own gravity. A model provides its effects, the joint axes, the joint
    order and the formulation; it is fitted if one of them is required, or if `fits`. Samples that
    were held out of its fit are left out.

    :param effects: names of the effects to test; None for all.
    :param learning: options of that fit.
    :raises DataError: if a fact on the joints is refused.
    :raises OptionError: if an effect is unknown.
    """
    from gravity_comp_ros.diagnosis.diagnose import diagnose
    from gravity_comp_ros.diagnosis.verdict import DiagnosisOptions
    options = DiagnosisOptions(effects=None if effects is None else tuple(effects))
    if model is not None:
        facts = arm_facts(recording, model=model)
        use = not_held_out(model, recording)
        recording = recording if use.all() else replace(recording, use=use)
    else:
        arm = known_arm(recording, learning)
        if (fits or arm.geometry is not None or arm.order.source == AS_RECORDED
                or learning.formulation not in (None, 'auto')):
            learned = learn(recording, learning, progress=progress, arm=arm)
            model, facts = learned.model, learned.facts
        else:
            recording = arm.of(recording)
            facts = arm_facts(recording, arm)
    return Diagnosed(diagnose(recording.used, model, options, progress), model, recording, facts)


def add_to_model(model: GravityModel, recording: Recording, effects: Sequence[str],
                 progress: Progress | None = None) -> Refit:
    """
    Add effects to a model and refit gravity and effects; the history keeps the old model.

    The slow samples are fitted, as in `fit_model`, without those held out of the original fit.
    Without effects only the held-out error is computed.

    :raises DataError: if a fact on the joints is refused.
    """
    from gravity_comp_ros.estimation.refit import refit
    recording = recording.select_joints(model.joints)
    arm_facts(recording, model=model)
    fitted = with_enough_motion(replace(recording, use=not_held_out(model, recording)))
    result = refit(recording.samples, model, requests(effects, model.joints),
                   use=slow_mask(fitted), progress=progress)
    changed = with_step(result.model, model, result.added, now(), *result.by_joint())
    provenance = {**model.provenance, 'bags': merged_bags(model, recording.reports)}
    return replace(result, model=replace(changed, provenance=provenance))


def not_held_out(model: GravityModel, recording: Recording) -> BoolArray:
    """Return the mask (M,) of usable samples outside the guarded blocks held out of the fit."""
    blocks = held_out_blocks(model, recording.reports)
    return recording.usable & ~within(recording.samples, blocks, GUARD)


def update_model(model: GravityModel, recording: Recording,
                 arm: KnownArm) -> tuple[UpdateResult, KnownArm]:
    """
    Update the gravity model after a payload change; its effects stay unchanged.

    Returns the update and the arm used; axes from a recording are used only if they match.

    :raises DataError: if a fact on the joints is refused.
    """
    from gravity_comp_ros.estimation.update import update
    recording = recording.select_joints(model.joints)
    try:
        arm_facts(recording, model=model, min_ratio=OPTIONS.min_error)
    except DataError as problem:
        raise DataError(f'{problem}. A payload changes no axis, no gain and no vertical') from None
    gravity = _gravity_alone(model, recording)
    try:
        result = update(model, gravity, geometry=arm.geometry)
    except ModelMismatchError as problem:
        if arm.geometry is None or arm.from_user:
            raise
        arm = KnownArm(arm.order, problem=f'robot description not used: {problem}')
        result = update(model, gravity)
    *before, last = result.model.provenance['updates']
    bags = [report.to_json() for report in recording.reports]
    provenance: dict[str, Any] = {
        **result.model.provenance, 'bags': merged_bags(model, recording.reports),
        'updates': [*before, {'when': now(), 'bags': bags, **last}]}
    changed = with_step(replace(result.model, provenance=provenance), model, (PAYLOAD,), now(),
                        result.report.rmse_before, result.report.rmse, UPDATED)
    return replace(result, model=changed), arm


def merged_bags(model: GravityModel, reports: Iterable[ReadReport]) -> list[dict[str, Any]]:
    """Return the recordings of the model's provenance, and those of `reports` that are new."""
    known = list(model.provenance.get('bags', ()))
    seen = {bag['sha256'] for bag in known}
    return [*known, *(report.to_json() for report in reports if report.sha256 not in seen)]


def held_out_blocks(model: GravityModel, reports: Sequence[ReadReport]) -> list[Block]:
    """Return the blocks of these recordings held out of the fit."""
    blocks = (model.provenance.get('holdout') or {}).get('blocks', ())
    return [Block(run, block['start'], block['end'])
            for run, report in enumerate(reports)
            for block in blocks if block['sha256'] == report.sha256]


def _gravity_alone(model: GravityModel, recording: Recording) -> JointSamples:
    """Return the slow samples, minus the torque of the model's effects."""
    slow = recording.slow
    if not model.applied.effects:
        return slow
    torque = effect_torque(model, recording.samples)[numbers_in(recording.samples, slow)]
    return replace(slow, tau=slow.tau - torque)


def compare_model(model: GravityModel, recording: Recording) -> Comparison:
    """Compare gravity and effects of a model with the measured torques of the slow samples."""
    recording = recording.select_joints(model.joints)
    return compare(model, recording.slow, recording.samples)
