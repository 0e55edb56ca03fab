"""Candidate models of a fit job: the change of the model in use, and full fits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

from gravity_comp_ros.effects.predict import effect_torque, fitted_torque, predict_torque
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError, FitError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit_as, FitResult as FullFit
from gravity_comp_ros.estimation.payload_path import payload_path
from gravity_comp_ros.estimation.requested_fit import requested_fit
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.evaluation.expected_residual import residual_noise
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.comparison import Prediction
from gravity_comp_ros.node.epoch import FULL_FIT_SAMPLES
from gravity_comp_ros.node.job_messages import Job


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate(Prediction):
    """A model with its prediction at the samples of a job, and its full fit if it is one."""

    model: GravityModel
    how: str
    fit: FullFit | None


def candidate(model: GravityModel, job: Job, how: str = '',
              fit: FullFit | None = None) -> Candidate:
    """Return a model with its torque at the samples of a job, effects included."""
    samples = job.rows.samples
    return Candidate(predict_torque(model, samples), residual_noise(model),
                     fitted_torque(model, samples), model=model, how=how, fit=fit)


def candidates(job: Job, chain: GravityModel | None) -> Iterator[Candidate]:
    """
    Yield the candidate models of a job.

    :param chain: the gravity of its base as a chain, None where no chain explains it.
    """
    base, train = chain or job.base, job.rows.train
    if base is not None and base.energy is None:
        base = None
    effects = job.settings.effects
    requested = requests(effects, train.names)
    new_effects = [request.target for request in requested
                   if base is None or not base.applied.has(request.effect.name, request.joint)]
    if job.on_request and new_effects:
        base = None
        if len(train) < FULL_FIT_SAMPLES:
            raise FitError(f'{len(train)} training samples; a model with '
                           f'{", ".join(effects)} requires {FULL_FIT_SAMPLES}: keep '
                           'moving slowly')
    if base is None:
        yield from _full_fits(job)
        return
    samples = replace(train, tau=train.tau - effect_torque(base, train))
    changed = update(base, samples, geometry=base.geometry).model
    yield candidate(changed, job, 'change of the old model')
    if len(train) >= FULL_FIT_SAMPLES:
        # There is a result already, so a full fit may fail.
        with suppress(FitError, DataError):
            yield from _full_fits(job)


def _full_fits(job: Job) -> Iterator[Candidate]:
    """
    Yield models fitted to the samples alone, of the formulation of the job.

    With `auto` these are the chain and, with its effects, the sparse potential.
    """
    fits = [full_fit(job)]
    if job.settings.formulation == 'auto':
        with suppress(FitError, DataError):
            fits.append(fit_as('potential', fits[0], options_of(job)))
    for fit in fits:
        yield candidate(fit.model, job, f'full fit, {fit.model.formulation}', fit)


def options_of(job: Job) -> FitOptions:
    """Return the options of a full fit, with known axes if it uses them."""
    formulation = job.settings.formulation
    formulation = 'chain' if formulation == 'auto' else formulation
    return FitOptions(formulation, geometry=job.geometry if formulation == 'chain' else None)


def full_fit(job: Job) -> FullFit:
    """
    Return a fit to the training samples alone, with the requested effects.

    Of the effects that resemble gravity only the requested ones are tested: the feed-forward is
    gravity, and what holds the arm must not be assigned to another effect.

    :raises FitError: if there are too few samples.
    :raises DataError: if the samples do not excite a requested effect.
    """
    samples = job.rows.train
    # Without a request the effects of the model in use are predicted again.
    targets = job.settings.effects or (
        tuple(e.target for e in job.model.applied.effects) if job.model else ())
    requested = requests(targets, samples.names)
    names = {request.effect.name for request in requested}
    tested = [effect for effect in all_effects().values()
              if not effect.resembles_gravity or effect.name in names]
    result = requested_fit(samples, requested, options_of(job), tested)
    if job.base is None:
        return result
    # Distances learned from earlier payloads stay valid.
    return replace(result, model=replace(
        result.model, payload_path=payload_path(job.base, result.model)))
