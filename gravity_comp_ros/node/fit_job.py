"""What the fit process does: fit, judge the result on held-out samples, and test it."""

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
from gravity_comp_ros.estimation.subset_stability import instability
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node import outliers
from gravity_comp_ros.node.absolute_tests import (
    dead_joint, first_model_objection, loose_objection, lost_gravity, reference_noise)
from gravity_comp_ros.node.base_chain import BaseChains, changed_by_payload, without_friction
from gravity_comp_ros.node.fit_messages import Job, Outcome
from gravity_comp_ros.node.live_friction import (
    friction_of_both, moving_rms, residual_noise, rms, usual_residual)
from gravity_comp_ros.node.model_acceptance import judge, Prediction
from gravity_comp_ros.node.payload_test import objections, PayloadEvidence
from gravity_comp_ros.node.self_confirmation import echo_objection
import numpy as np

# Fewer samples do not tell a whole model: it would fit them, and be wrong where the arm goes
# next. What changed of an old model takes a fraction of them; see docs/node.md.
FROM_NOTHING = 100
CHANGE, WHOLE = 'change of the old model', 'fit from nothing'
SPARSE = f'{WHOLE}, potential'
# By this share a sparse potential must predict better than a chain to be taken.
_CLEARLY = 0.1
# A whole model must predict better than a change of the old model by this part: on some thirty
# held-out samples chance made a tenth, of a model that was wrong elsewhere.
_MORE_THAN_CHANGE = 0.25
# Noise of earlier epochs counts so many times where gravity is fitted beside new effects.
WITH_EFFECTS = 2.0
_chains = BaseChains()


def work(job: Job) -> Outcome:
    """
    Fit a job, judge the result on its held-out samples, and test it against what is known.

    With few samples and a base only the change of that is fitted; with more a whole model as
    well, and the one that predicts the held-out samples better counts. Where somebody asked for
    effects that the base does not have, only a whole model will do.

    :raises FitError: if there is no result, or too few samples for the effects.
    :raises DataError: if the samples do not show an effect that was asked for.
    """
    start = time.monotonic()
    chain = None if job.base is None else _chains.of(job.base, job.geometry)
    job, left_out, first = _without_outliers(job, chain)
    found = list(_candidates(job, chain, first))
    how, model, here = _best(found, job)
    more = job.old is not None and len(job.train) > job.old.coverage.n_samples
    verdict = judge(here, None if job.old is None else predicted(job.old, job), job.train,
                    job.held, more)
    if len(found) > 1:
        verdict = replace(verdict, reason=f'{verdict.reason}; tried: {_tried(found, job)}')
    if not verdict.compensated:
        change = next((other for name, other in found if name == CHANGE), None)
        echo = None if job.sent is None else echo_objection(
            job.sent, job.train, job.held, here.train, here.held,
            job.base is not None and _targets(model) != _targets(job.base))
        if echo is not None:
            verdict = verdict.not_yet(echo)
        elif (broken := _broken(job, chain, change, model)) is not None:
            verdict = verdict.refused(broken)
        elif verdict.better and how != CHANGE and (why := _unsettled(model, job)) is not None:
            verdict = verdict.not_yet(why)
    return Outcome(job.number, job.epoch, model, verdict, how, time.monotonic() - start,
                   job.train.q.min(axis=0), job.train.q.max(axis=0), left_out)


def _without_outliers(job: Job, chain: GravityModel | None
                      ) -> tuple[Job, Mapping[str, int], tuple[str, GravityModel] | None]:
    """
    Return the job without samples at which something else than gravity acted for a moment.

    Without a chain a model is fitted to find them; it is returned where it is one of the job's.
    """
    first = None
    every, names = concatenate((job.train, job.held)), job.train.names
    if chain is not None and chain.joints == names:
        gravity = concatenate(_beside_friction(job.base or chain, job))
        found = outliers.outliers_of_change(gravity, chain)
    else:
        try:
            how, model = next(_wholes(replace(job, effects=())))
        except (FitError, DataError):
            return job, {}, None
        said = predicted(model, job)
        found = outliers.outliers_of_fit(every.tau - np.concatenate(
            (said.train + said.beside_train, said.held + said.beside_held)), every)
        first = None if job.effects else (how, model)
    if not found.any():
        return job, {}, first
    train, held = found[:len(job.train)], found[len(job.train):]
    return replace(job, train=outliers.without(job.train, train),
                   held=outliers.without(job.held, held),
                   sent=outliers.sent_without(job.sent, train, held)), outliers.counts(
                       names, found), None


def _best(found: list[tuple[str, GravityModel]], job: Job) -> tuple[str, GravityModel, Prediction]:
    """
    Return the first model unless a later one predicts the held-out samples clearly better.

    A change of the old model extrapolates best, then a chain, and a potential does not, so chance
    must not decide between them.
    """
    (how, model), *others = found
    here = predicted(model, job)
    for name, other in others:
        there = predicted(other, job)
        margin = _MORE_THAN_CHANGE if how == CHANGE else _CLEARLY if name == SPARSE else 0.0
        if judge(there, here, job.train, job.held, margin=margin).better:
            how, model, here = name, other, there
    return how, model, here


def _tried(found: list[tuple[str, GravityModel]], job: Job) -> str:
    """Return the held-out RMSE of every model that was fitted, over all joints."""
    every = [predicted(model, job) for _, model in found]
    errors = [moving_rms(job.held.tau - each.held - each.beside_held, job.held.qd)
              for each in every]
    return ', '.join(f'{name} {np.sqrt((error ** 2).mean()):.3g} N·m'
                     for (name, _), error in zip(found, errors))


def _candidates(job: Job, chain: GravityModel | None,
                first: tuple[str, GravityModel] | None) -> Iterator[tuple[str, GravityModel]]:
    """Yield the models to judge; `first` is the first whole one where it was fitted already."""
    base = chain or job.base
    if base is not None and (base.energy is None or base.joints != job.train.names):
        base = None
    wanted = requests(job.effects, job.train.names)
    news = [request.target for request in wanted
            if base is None or not base.applied.has(request.effect.name, request.joint)]
    if job.asked and news:
        base = None
        if len(job.train) < FROM_NOTHING:
            raise FitError(f'{len(job.train)} samples to learn from; a model with '
                           f'{", ".join(job.effects)} takes {FROM_NOTHING}: keep moving slowly')
    if base is not None:
        yield CHANGE, changed(base, job.train)
    if base is None:
        yield from _wholes(job, first)
    elif len(job.train) >= FROM_NOTHING:
        # There is a result already; samples that show too little for a whole one do no harm.
        with suppress(FitError, DataError):
            yield from _wholes(job, first)


def _wholes(job: Job, first: tuple[str, GravityModel] | None = None
            ) -> Iterator[tuple[str, GravityModel]]:
    """
    Yield models fitted to the samples alone: the one that is asked for.

    With `auto` the chain comes first, and the sparse potential by ADMM beside it; known axes are
    tested against the samples (`estimation.formulation_choice`).
    """
    if job.formulation != 'auto':
        yield first or (WHOLE, whole(job, FitOptions(job.formulation)))
        return
    if first is not None and first[0] == SPARSE:
        # The chain has failed.
        yield first
        return
    known = job.geometry is not None and job.geometry.joints == job.train.names
    options = FitOptions('auto', geometry=job.geometry) if known else FitOptions('chain')
    # The sparse fit must succeed; the chain beside it may fail.
    with suppress(FitError, DataError):
        yield first or (f'{WHOLE}, chain', whole(job, options))
    yield SPARSE, whole(job, FitOptions('potential'))


def _unsettled(model: GravityModel, job: Job) -> str | None:
    options = FitOptions(model.formulation,
                         geometry=job.geometry if model.geometry is not None else None)
    return instability(model, job.train, residual_noise(model),
                       lambda early: whole(replace(job, train=early), options))


def _broken(job: Job, chain: GravityModel | None, change: GravityModel | None,
            model: GravityModel) -> str | None:
    """
    Return why the effort of this job cannot be what the drives supply, None if it can.

    :param change: the change of `chain` where it was fitted already; `model` is the best one.
    """
    here = predicted(model, job)
    residual = np.maximum(
        outliers.rms_without(job.train, here.train + here.beside_train),
        outliers.rms_without(job.held, here.held + here.beside_held))
    base = job.base
    if base is None or base.joints != job.train.names:
        return first_model_objection(job.train, residual)
    allowance = 1.0
    source = base
    if _targets(model) != _targets(base):
        # Effects that were asked for are no payload, and gravity no longer imitates them.
        change, source, allowance = None, model, WITH_EFFECTS
    train, held = _beside_friction(source, job)
    gravity = concatenate((train, held))
    before = base.predict(gravity.q)
    noise = allowance * reference_noise(usual_residual(base), gravity, before)
    for test in (lost_gravity, dead_joint):
        if (lost := test(gravity, before, noise)) is not None:
            return lost
    if chain is None or chain.joints != job.train.names:
        return loose_objection(job.train, residual, noise,
                               rms(here.train - predict_torque(base, job.train)))
    loaded = change or changed_by_payload(without_friction(chain), train)
    evidence = PayloadEvidence(chain, loaded, train, held, noise)
    return next(objections(evidence, job.payload, job.geometry), None)


def _targets(model: GravityModel) -> set[str]:
    return {effect.target for effect in model.applied.effects}


def _gravity(base: GravityModel, samples: JointSamples) -> JointSamples:
    return replace(samples, tau=samples.tau - effect_torque(base, samples))


def _beside_friction(model: GravityModel, job: Job) -> tuple[JointSamples, JointSamples]:
    """Return both sets of samples without the effects, friction and offset of a model."""
    train, held = (_gravity(model, part) for part in (job.train, job.held))
    friction = friction_of_both(model, job.train, job.held)
    return (replace(train, tau=train.tau - friction[0]),
            replace(held, tau=held.tau - friction[1]))


def changed(base: GravityModel, samples: JointSamples) -> GravityModel:
    """Return the base with what changed of its gravity; its effects stay as they are."""
    return changed_by_payload(base, _gravity(base, samples))


def whole(job: Job, options: FitOptions) -> GravityModel:
    """Return a model fitted to the samples alone, with the effects that are asked for."""
    # What the model in use was given stays, unless other effects are asked for.
    targets = job.effects or tuple(e.target for e in job.old.applied.effects) if job.old \
        else job.effects
    wanted = requests(targets, job.train.names)
    made = (fit_with_effects(job.train, job.train, wanted, options).joint.model if wanted
            else fit(job.train, options).model)
    if job.base is None or job.base.joints != made.joints:
        return made
    # What earlier payloads showed of the arm stays.
    return replace(made, payload_path=payload_path(job.base, made))


def predicted(model: GravityModel, job: Job) -> Prediction:
    """Return what a model says of the samples of a job, effects included."""
    return Prediction(predict_torque(model, job.train), predict_torque(model, job.held),
                      residual_noise(model), *friction_of_both(model, job.train, job.held))
