"""Fit of a job in the fit process: candidate models, held-out comparison, plausibility tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
import time

from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.predict import effect_torque, predict_torque
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError, FitError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.fit_with_effects import fit_with_effects
from gravity_comp_ros.estimation.payload_path import payload_path
from gravity_comp_ros.estimation.subset_stability import convergence_objection
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node import outliers
from gravity_comp_ros.node.base_chain import BaseChains, changed_by_payload, without_friction
from gravity_comp_ros.node.effort_plausibility import (
    dead_joint_objection, first_model_objection, lost_gravity_objection, objection_without_chain,
    reference_noise)
from gravity_comp_ros.node.fit_messages import FitJob, FitResult
from gravity_comp_ros.node.live_nuisance import (
    expected_residual, interleaved_nuisance, moving_rms, residual_noise, rms, without_nuisance)
from gravity_comp_ros.node.model_acceptance import compare_models, Prediction, Verdict
from gravity_comp_ros.node.payload_test import objections, PayloadEvidence
from gravity_comp_ros.node.self_confirmation import echo_objection
import numpy as np

# Minimum number of training samples of a full fit. With fewer it overfits and extrapolates badly;
# the change of an old model requires a fraction of them (docs/node.md).
MIN_FULL_FIT_SAMPLES = 100
# Kind of a fit, as in replies and diagnostics.
CHANGE, FULL_FIT = 'change of the old model', 'full fit'
SPARSE = f'{FULL_FIT}, potential'
# Margin of the held-out error by which a sparse potential must beat a chain.
_SPARSE_MARGIN = 0.1
# Margin by which a full fit must beat a change of the old model. On about thirty held-out samples
# a model that was wrong at other poses was better by a tenth.
_FULL_FIT_MARGIN = 0.25
# Factor of the noise of earlier epochs where gravity is fitted jointly with new effects.
NEW_EFFECTS_FACTOR = 2.0
# A candidate model, with how it was fitted.
Candidate = tuple[str, GravityModel]
_chains = BaseChains()


def run_fit(job: FitJob) -> FitResult:
    """
    Fit a job, compare the best candidate with the model in use, and test its plausibility.

    With few samples and a base only the change of the base is fitted. With more samples a full
    fit is a candidate as well, and the held-out error decides. A request for effects that the
    base does not have requires a full fit.

    :raises FitError: if there is no result, or there are too few samples for the effects.
    :raises DataError: if the samples do not excite a requested effect.
    """
    start = time.monotonic()
    chain = None if job.base is None else _chains.of(job.base, job.geometry)
    job, left_out, first = _without_outliers(job, chain)
    candidates = list(_candidates(job, chain, first))
    how, model, prediction = _best(candidates, job)
    has_more_samples = job.old is not None and len(job.train) > job.old.coverage.n_samples
    verdict = compare_models(prediction, None if job.old is None else predicted(job.old, job),
                             job.train, job.held_out, has_more_samples)
    if len(candidates) > 1:
        verdict = replace(verdict,
                          reason=f'{verdict.reason}; tried: {_candidate_errors(candidates, job)}')
    if not verdict.compensated:
        change = next((other for name, other in candidates if name == CHANGE), None)
        verdict = _tested(verdict, job, chain, change, (how, model), prediction)
    return FitResult(job.number, job.epoch, model, verdict, how, time.monotonic() - start,
                     job.train.q.min(axis=0), job.train.q.max(axis=0), left_out)


def _tested(verdict: Verdict, job: FitJob, chain: GravityModel | None,
            change: GravityModel | None, best: Candidate, prediction: Prediction) -> Verdict:
    """Return the verdict after the tests for an echo, broken effort, and too little motion."""
    how, model = best
    echo = None if job.sent is None else echo_objection(
        job.sent, job.train, job.held_out, prediction.train, prediction.held_out,
        job.base is not None and _targets(model) != _targets(job.base))
    if echo is not None:
        return verdict.not_yet(echo)
    if (broken := _broken_effort(job, chain, change, model, prediction)) is not None:
        return verdict.refused(broken)
    if verdict.better and how != CHANGE and (why := _not_converged(model, job)) is not None:
        return verdict.not_yet(why)
    return verdict


def _without_outliers(job: FitJob, chain: GravityModel | None
                      ) -> tuple[FitJob, Mapping[str, int], Candidate | None]:
    """
    Return the job without outliers, their number per joint, and the model that identified them.

    With a chain the outliers are those of its change. Without one they are those of a full fit,
    which is returned if it is a candidate of the remaining job.
    """
    first = None
    samples, names = concatenate((job.train, job.held_out)), job.train.names
    if chain is not None and chain.joints == names:
        gravity = concatenate(_gravity_samples(job.base or chain, job))
        is_outlier = outliers.outliers_of_change(gravity, chain)
    else:
        try:
            how, model = next(_full_fits(replace(job, effects=())))
        except (FitError, DataError):
            return job, {}, None
        prediction = predicted(model, job)
        is_outlier = outliers.outliers_of_fit(samples.tau - np.concatenate(
            (prediction.train + prediction.nuisance_train,
             prediction.held_out + prediction.nuisance_held_out)), samples)
        first = None if job.effects else (how, model)
    if not is_outlier.any():
        return job, {}, first
    train, held_out = is_outlier[:len(job.train)], is_outlier[len(job.train):]
    job = replace(job, train=outliers.without(job.train, train),
                  held_out=outliers.without(job.held_out, held_out),
                  sent=outliers.sent_without(job.sent, train, held_out))
    return job, outliers.counts(names, is_outlier), None


def _best(candidates: list[Candidate], job: FitJob) -> tuple[str, GravityModel, Prediction]:
    """
    Return the first candidate unless a later one has a smaller held-out error by a margin.

    A change of the old model extrapolates best, then a chain, then a potential. The margins
    exceed the statistical uncertainty of the error.
    """
    (how, model), *others = candidates
    best = predicted(model, job)
    for name, other in others:
        prediction = predicted(other, job)
        margin = _FULL_FIT_MARGIN if how == CHANGE else _SPARSE_MARGIN if name == SPARSE else 0.0
        if compare_models(prediction, best, job.train, job.held_out, margin=margin).better:
            how, model, best = name, other, prediction
    return how, model, best


def _candidate_errors(candidates: list[Candidate], job: FitJob) -> str:
    """Return the held-out RMSE of each candidate over all joints as text."""
    texts = []
    for how, model in candidates:
        prediction = predicted(model, job)
        error = moving_rms(job.held_out.tau - prediction.held_out - prediction.nuisance_held_out,
                           job.held_out.qd)
        texts.append(f'{how} {np.sqrt((error ** 2).mean()):.3g} N·m')
    return ', '.join(texts)


def _candidates(job: FitJob, chain: GravityModel | None,
                first: Candidate | None) -> Iterator[Candidate]:
    """Yield the candidate models; `first` is the first full fit where it exists already."""
    base = chain or job.base
    if base is not None and (base.energy is None or base.joints != job.train.names):
        base = None
    requested = requests(job.effects, job.train.names)
    new_effects = [request.target for request in requested
                   if base is None or not base.applied.has(request.effect.name, request.joint)]
    if job.on_request and new_effects:
        base = None
        if len(job.train) < MIN_FULL_FIT_SAMPLES:
            raise FitError(f'{len(job.train)} training samples; a model with '
                           f'{", ".join(job.effects)} requires {MIN_FULL_FIT_SAMPLES}: keep '
                           'moving slowly')
    if base is None:
        yield from _full_fits(job, first)
        return
    yield CHANGE, changed_by_payload(base, _without_effects(base, job.train))
    if len(job.train) >= MIN_FULL_FIT_SAMPLES:
        # There is a result already, so a full fit may fail.
        with suppress(FitError, DataError):
            yield from _full_fits(job, first)


def _full_fits(job: FitJob, first: Candidate | None = None) -> Iterator[Candidate]:
    """
    Yield models fitted to the samples alone, of the formulation of the job.

    With `auto` these are the chain and then the sparse potential by ADMM; known axes are tested
    against the samples (`estimation.formulation_choice`).
    """
    if job.formulation != 'auto':
        yield first or (FULL_FIT, full_fit(job, FitOptions(job.formulation)))
        return
    if first is not None and first[0] == SPARSE:
        # The chain has failed.
        yield first
        return
    known = job.geometry is not None and job.geometry.joints == job.train.names
    options = FitOptions('auto', geometry=job.geometry) if known else FitOptions('chain')
    # The sparse fit must succeed; the chain may fail.
    with suppress(FitError, DataError):
        yield first or (f'{FULL_FIT}, chain', full_fit(job, options))
    yield SPARSE, full_fit(job, FitOptions('potential'))


def _not_converged(model: GravityModel, job: FitJob) -> str | None:
    options = FitOptions(model.formulation,
                         geometry=job.geometry if model.geometry is not None else None)
    return convergence_objection(model, job.train, residual_noise(model),
                                 lambda early: full_fit(replace(job, train=early), options))


def _broken_effort(job: FitJob, chain: GravityModel | None, change: GravityModel | None,
                   model: GravityModel, prediction: Prediction) -> str | None:
    """
    Return why the effort of this job is broken, None if it is not.

    :param change: the change of `chain` where it was fitted already; `model` is the best one.
    """
    residual = np.maximum(
        outliers.rms_without(job.train, prediction.train + prediction.nuisance_train),
        outliers.rms_without(job.held_out, prediction.held_out + prediction.nuisance_held_out))
    base = job.base
    if base is None or base.joints != job.train.names:
        return first_model_objection(job.train, residual)
    allowance = 1.0
    source = base
    if _targets(model) != _targets(base):
        # With other effects gravity changes without a change of the payload.
        change, source, allowance = None, model, NEW_EFFECTS_FACTOR
    train, held_out = _gravity_samples(source, job)
    gravity = concatenate((train, held_out))
    before = base.predict(gravity.q)
    noise = allowance * reference_noise(expected_residual(base), gravity, before)
    for test in (lost_gravity_objection, dead_joint_objection):
        if (objection := test(gravity, before, noise)) is not None:
            return objection
    if chain is None or chain.joints != job.train.names:
        return objection_without_chain(job.train, residual, noise,
                                       rms(prediction.train - predict_torque(base, job.train)))
    loaded = change or changed_by_payload(without_friction(chain), train)
    evidence = PayloadEvidence(chain, loaded, train, held_out, noise)
    return next(objections(evidence, job.payload, job.geometry), None)


def _targets(model: GravityModel) -> set[str]:
    return {effect.target for effect in model.applied.effects}


def _without_effects(base: GravityModel, samples: JointSamples) -> JointSamples:
    return replace(samples, tau=samples.tau - effect_torque(base, samples))


def _gravity_samples(model: GravityModel, job: FitJob) -> tuple[JointSamples, JointSamples]:
    """Return both sets of samples without the effects and nuisance terms of a model."""
    train, held_out = (_without_effects(model, part) for part in (job.train, job.held_out))
    nuisance = interleaved_nuisance(model, job.train, job.held_out)
    return (without_nuisance(model, train, nuisance[0]),
            without_nuisance(model, held_out, nuisance[1]))


def full_fit(job: FitJob, options: FitOptions) -> GravityModel:
    """Return a model fitted to the training samples alone, with the requested effects."""
    # Without a request the effects of the model in use are fitted again.
    targets = job.effects or tuple(e.target for e in job.old.applied.effects) if job.old \
        else job.effects
    requested = requests(targets, job.train.names)
    model = (fit_with_effects(job.train, job.train, requested, options).joint.model if requested
             else fit(job.train, options).model)
    if job.base is None or job.base.joints != model.joints:
        return model
    # Distances learned from earlier payloads stay valid.
    return replace(model, payload_path=payload_path(job.base, model))


def predicted(model: GravityModel, job: FitJob) -> Prediction:
    """Return the torque of a model at the samples of a job, effects included."""
    return Prediction(predict_torque(model, job.train), predict_torque(model, job.held_out),
                      residual_noise(model),
                      *interleaved_nuisance(model, job.train, job.held_out))
