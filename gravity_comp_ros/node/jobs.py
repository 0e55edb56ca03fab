"""
Jobs of the fit process: the only module of the node that calls the learning half.

It fits candidate models, diagnoses and plans with `estimation`, `diagnosis` and `planning`, and
leaves the decision about a result to `acceptance`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
import time

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import conclude
from gravity_comp_ros.effects.predict import effect_torque, fitted_torque, predict_torque
from gravity_comp_ros.effects.registry import all_effects, requests
from gravity_comp_ros.errors import DataError, FitError, GravityCompError
from gravity_comp_ros.estimation.chain_of_model import axes_under, ChainOfModel
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.fit import fit, fit_again, FitResult as FullFit
from gravity_comp_ros.estimation.payload_path import payload_path
from gravity_comp_ros.estimation.refit import fit_options_of
from gravity_comp_ros.estimation.subset_stability import convergence_objection
from gravity_comp_ros.estimation.update import payload_change_weights, update
from gravity_comp_ros.evaluation.expected_residual import expected_residual, residual_noise, rms
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.noise import floor, is_outlier, outlier_weights
from gravity_comp_ros.node import acceptance, checks
from gravity_comp_ros.node.acceptance import (
    Candidate, compare, held_out_rmse, not_output, reference_noise)
from gravity_comp_ros.node.checks import (
    Check, DIAGNOSIS, FIT, FitResult, Job, PAYLOAD, PayloadResult, Result)
from gravity_comp_ros.node.epoch import FULL_FIT_SAMPLES, REST_SPEED
from gravity_comp_ros.node.hypotheses import moving_rms, Window
from gravity_comp_ros.node.options import CHECKS
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.worker.serve import ProgressCallback, Work
import numpy as np

_chains = ChainOfModel()


def fitting() -> Work:
    """Return the function that runs the jobs of the node."""
    runs: dict[str, Callable[[Job], Result]] = {
        FIT: run_fit, DIAGNOSIS: run_diagnosis, PAYLOAD: run_payload_test}

    def run_job(job: Job, _: ProgressCallback) -> Result:
        return runs[job.kind](job)

    return run_job


def run_diagnosis(job: Job) -> str:
    """
    Return the findings of a diagnosis, and the motion that resolves the open ones, as text.

    :raises DataError: if there are too few samples.
    """
    start, samples, model = time.monotonic(), job.rows.samples, job.model
    estimated = estimate(samples, FitOptions() if model is None else fit_options_of(model),
                         old=model)
    diagnosis = conclude(estimated, model)
    # Named as `gravity_comp add` and the parameter `effects` accept them.
    lines = [wording.verdict(diagnosis), ', '.join(
        f'{target(item.effect or "unexplained", item.joint)} ({item.verdict})'
        for item in diagnosis.findings)]
    if model is not None:
        with suppress(GravityCompError):
            planned = plan(samples, model, diagnosis=diagnosis, estimated=estimated)
            lines.append(
                f'to resolve open findings, move for {planned.trajectory.duration:.0f} s: '
                f'{"; ".join(part.sentence for part in planned.parts)} '
                '(`gravity_comp plan` on a recording writes that motion)')
    lines.append(f'{len(samples)} slow samples, {time.monotonic() - start:.1f} s')
    return ' | '.join(filter(None, lines))


def run_payload_test(job: Job) -> PayloadResult:
    """Return whether the samples show another payload."""
    samples, model = job.rows.samples, job.model
    assert model is not None
    chain = _chains.of(model, job.geometry)
    if chain is None:
        return PayloadResult('the effort has changed; a payload cannot be tested, because no '
                             'serial chain explains this arm', is_other=True)
    window = _window(job, model, chain, model, 1.0)
    noise, residual = window.noise, rms(window.samples.tau - model.predict(samples.q))
    tables = window.tables()
    judged = acceptance.suspicion_checks(tables)
    present, *other = judged
    seconds = samples.t[-1] - samples.t[0]
    k = int(np.argmax(residual / noise))
    figures = (f'residual of {samples.names[k]} {residual[k]:.3g} N·m, noise of the training '
               f'{noise[k]:.3g}, {len(samples)} samples in {seconds:.1f} s')
    values = {'joint': samples.names[k], 'residual [Nm]': f'{residual[k]:.3g}',
              'noise of the training [Nm]': f'{noise[k]:.3g}', 'samples': str(len(samples)),
              'from [s]': f'{samples.t[0]:.3f}', 'to [s]': f'{samples.t[-1]:.3f}',
              'log evidence': f'{present.statistic:.1f}'}
    what = 'a body'
    if (body := tables[0].body()) is not None:
        what = f'a change of {body[0]:.3g} kg'
        values |= {'mass [kg]': f'{body[0]:.3g}',
                   'standard deviation of the mass [kg]': f'{body[1]:.2g}'}
    # A push or a varying force that is as likely as a body is no reason for an alarm.
    ambiguous = any(0.0 <= check.statistic < check.limit for check in other
                    if check.name in (checks.NO_PUSH, checks.NOT_VARYING))
    refusal, is_other = checks.failed(other), False
    if not present.passed or ambiguous:
        text = 'no payload is suspected'
    elif refusal is not None:
        text, is_other = ('the effort has changed in a way that no payload explains: '
                          f'{refusal.text}'), True
    else:
        text = f'another payload is suspected: {what} on the last link explains the effort'
    return PayloadResult(f'{text}; {figures}', tuple(judged), values, is_other)


def run_fit(job: Job) -> FitResult:
    """
    Fit a job, compare the best candidate with the model in use, and check it.

    :raises FitError: if there is no result, or there are too few samples for the effects.
    :raises DataError: if the samples do not excite a requested effect.
    """
    if job.base is not None:
        return _compared_fit(job, [])
    job, check = acceptance.first_samples(job)
    try:
        return _compared_fit(job, [check])
    except (FitError, DataError) as error:
        if check.passed:
            raise
        raise DataError(check.text) from error


def _compared_fit(job: Job, judged: list[Check]) -> FitResult:
    """
    Return the best candidate.

    Outliers have a transient torque, such as that of an intermittent brake. They are those of the
    change of the base, which must not be fitted to them. They have little weight in a full fit.

    :param judged: checks of the samples, to which those of the candidate are added.
    """
    start, samples = time.monotonic(), job.rows.samples
    chain = None if job.base is None else _chains.of(job.base, job.geometry)
    tried = list[Candidate]()
    if job.base is not None and chain is not None:
        outlying = outliers_of_change(without_effects(job.base, samples)[0], chain)
    else:
        tried = list(candidates(job, None))
        outlying = outliers_of_fit(tried[0].residual(samples), samples)
    left_out = {name: int(n) for name, n in zip(samples.names, outlying.sum(axis=0)) if n}
    job = replace(job, rows=job.rows.select(~np.asarray(outlying.any(axis=1))))
    tried = [candidate(each.model, job, each.how, each.fit)
             for each in tried] or list(candidates(job, chain))
    best, rows = _best(tried, job), job.rows
    old = None if job.model is None else candidate(job.model, job)
    compared, errors = compare(best, old, rows, old is not None and len(
        rows.train) > old.model.coverage.n_samples)
    figures = '; '.join([*(check.text for check in judged if check.passed and check.text), errors])
    # The effort of an arm that compensates gravity itself is not checked further.
    if not any(check.name == checks.POSE_EXPLAINS and not check.passed for check in compared):
        judged = [*judged, *_checks(job, chain, best)]
    judged = [*judged, *compared]
    if best.fit is not None and checks.failed(judged) is None:
        judged.append(_converged(best.fit, job))
    if len(tried) > 1:
        figures += '; tried: ' + ', '.join(
            f'{each.how} {rms(held_out_rmse(each.residual(rows.samples), rows)):.3g} N·m'
            for each in tried)
    return FitResult(best.model, tuple(judged), figures, best.how, time.monotonic() - start,
                     left_out)


def _checks(job: Job, chain: GravityModel | None, best: Candidate) -> Iterator[Check]:
    """Yield the checks of the samples themselves: an echo, faulty effort, payload limits."""
    base, samples, model = job.base, job.rows.samples, best.model
    has_new_effects = base is not None and {
        effect.target for effect in model.applied.effects} != {
        effect.target for effect in base.applied.effects}
    echo = not_output(job.rows, best, has_new_effects)
    if echo is not None:
        yield echo
    error = best.residual(samples)
    residual = np.maximum(*(
        moving_rms(np.where(outliers_of_fit(error[part], samples.select(part)), 0.0, error[part]),
                   samples.qd[part]) for part in (job.rows.held_out, ~job.rows.held_out)))
    if base is None:
        yield acceptance.joints_agree(job.rows.train, residual)
        return
    # With other effects gravity changes without a change of the payload.
    source, factor = (model, CHECKS.new_effects) if has_new_effects else (base, 1.0)
    window = _window(job, base, chain, source, factor)
    if chain is None:
        change = rms(best.torque - predict_torque(base, samples))
        yield acceptance.gravity_present(window.samples, base.predict(samples.q),
                                         window.reference)
        yield acceptance.joints_agree(samples, residual, np.maximum(
            CHECKS.predicted * window.reference, CHECKS.max_largest * change))
        return
    yield from acceptance.body_checks(replace(window, noise=window.reference).tables())


def _window(job: Job, model: GravityModel, chain: GravityModel | None, source: GravityModel,
            factor: float) -> Window:
    """
    Return the samples of a job to compare with a model, as a chain if one explains it.

    :param source: model with the effects and nuisance terms to subtract.
    :param factor: of the reference noise.
    """
    gravity, friction = without_effects(source, job.rows.samples)
    reference = factor * reference_noise(expected_residual(model), gravity,
                                         gravity.tau - model.predict(gravity.q))
    axes = None if chain is None else axes_under(chain, job.geometry)
    return Window(gravity, friction, model, chain or model, residual_noise(model), reference,
                  job.settings, axes)


def _converged(fit: FullFit, job: Job) -> Check:
    options = options_of(job)
    why = convergence_objection(fit.model, job.rows.train, residual_noise(fit.model),
                                lambda part: fit_again(fit, options, part).model)
    return Check(checks.CONVERGED, float(why is not None), 0.5, text=why or '')


def outliers_of_change(gravity: JointSamples, chain: GravityModel) -> BoolArray:
    """Return a mask (M, N) of the torques that are outliers of a change of the chain's moments."""
    return _none_if_too_many(is_outlier(payload_change_weights(chain, gravity)))


def outliers_of_fit(residual: FloatArray, samples: JointSamples) -> BoolArray:
    """
    Return a mask (M, N) of the torques that are outliers of a model that was fitted to them.

    At rest friction can have any value, so a joint at rest has no outliers.

    :param residual: residual without friction and offset (M, N), N·m.
    """
    far = is_outlier(outlier_weights(residual, floor(samples.tau)))
    return _none_if_too_many(far & (np.abs(samples.qd) > REST_SPEED))


def _none_if_too_many(outliers: BoolArray) -> BoolArray:
    return outliers & (outliers.any(axis=1).mean() <= CHECKS.max_outliers)


def without_effects(model: GravityModel, samples: JointSamples) -> tuple[JointSamples, FloatArray]:
    """Return samples without the effects and nuisance terms of a model, and these (M, N), N·m."""
    others = effect_torque(model, samples) + fitted_torque(model, samples)
    return replace(samples, tau=samples.tau - others), others


def candidate(model: GravityModel, job: Job, how: str = '',
              fit: FullFit | None = None) -> Candidate:
    """Return a model with its torque at the samples of a job, effects included."""
    samples = job.rows.samples
    return Candidate(model, predict_torque(model, samples), residual_noise(model),
                     fitted_torque(model, samples), how, fit)


def candidates(job: Job, chain: GravityModel | None) -> Iterator[Candidate]:
    """
    Yield the candidate models of a job: the change of its base, and full fits.

    With few samples and a base only the change of the base is fitted. A request for effects that
    the base does not have requires a full fit.

    :param chain: the gravity of its base as a chain, None where no chain explains it.
    """
    base, train = chain or job.base, job.rows.train
    effects = job.settings.effects
    new_effects = job.on_request and any(
        base is None or not base.applied.has(request.effect.name, request.joint)
        for request in requests(effects, train.names))
    if new_effects and len(train) < FULL_FIT_SAMPLES:
        raise FitError(f'{len(train)} training samples; a model with {", ".join(effects)} '
                       f'requires {FULL_FIT_SAMPLES}: keep moving slowly')
    if chain is None or new_effects:
        yield from _full_fits(job)
        return
    samples = replace(train, tau=train.tau - effect_torque(chain, train))
    changed = update(chain, samples, geometry=chain.geometry).model
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
            fits.append(fit_again(fits[0], options_of(job), formulation='potential'))
    for each in fits:
        yield candidate(each.model, job, f'full fit, {each.model.formulation}', each)


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
    result = fit(samples, options_of(job), effects=requested, tested=tested)
    if job.base is None:
        return result
    # Distances learned from earlier payloads stay valid.
    return replace(result, model=replace(
        result.model, payload_path=payload_path(job.base, result.model)))


def _best(tried: list[Candidate], job: Job) -> Candidate:
    """
    Return the first candidate unless a later one has a smaller held-out error by a margin.

    A change of the old model extrapolates best, then a chain, then a potential. The margins
    exceed the statistical uncertainty of the error.
    """
    best, *others = tried
    for other in others:
        margin = CHECKS.full_fit_margin if best.fit is None else CHECKS.sparse_margin
        if checks.failed(compare(other, best, job.rows, margin=margin)[0]) is None:
            best = other
    return best
