"""
Jobs of the fit process: the only module of the node that calls the learning half.

It fits candidate models, diagnoses and plans with `estimation`, `diagnosis` and `planning`, and
leaves the decision about a result to `acceptance`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
import time

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import conclude
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.predict import effect_torque, fitted_torque, predict_torque
from gravity_comp_ros.errors import DataError, FitError, GravityCompError
from gravity_comp_ros.estimation.chain_of_model import axes_under, ChainOfModel
from gravity_comp_ros.estimation.estimate import Estimate, estimate, FitOptions
from gravity_comp_ros.estimation.fit import fit_again, FitResult as FullFit
from gravity_comp_ros.estimation.refit import fit_options_of
from gravity_comp_ros.estimation.subset_stability import convergence_objection
from gravity_comp_ros.estimation.update import payload_change_weights
from gravity_comp_ros.evaluation.expected_residual import expected_residual, residual_noise, rms
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.noise import floor, is_outlier, outlier_weights
from gravity_comp_ros.node import acceptance, checks
from gravity_comp_ros.node.acceptance import reference_noise
from gravity_comp_ros.node.candidates import Candidate, candidate, candidates, options_of
from gravity_comp_ros.node.checks import Check, OPTIONS
from gravity_comp_ros.node.comparison import compare, held_out_rmse, not_output
from gravity_comp_ros.node.epoch import REST_SPEED
from gravity_comp_ros.node.hypotheses import moving_rms, Window
from gravity_comp_ros.node.job_messages import (
    DIAGNOSIS, FIT, FitResult, Job, PAYLOAD, PayloadResult, Result)
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.worker.serve import ProgressCallback, Work
import numpy as np

_chains = ChainOfModel()


def fitting() -> Work:
    """Return the function that runs the jobs of the node."""
    return run_job


def run_job(job: Job, _: ProgressCallback) -> Result:
    """Run a job of any kind."""
    runs: dict[str, Callable[[Job], Result]] = {
        FIT: run_fit, DIAGNOSIS: run_diagnosis, PAYLOAD: run_payload_test}
    return runs[job.kind](job)


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
    ranking = ', '.join(f'{target(item.effect or "unexplained", item.joint)} ({item.verdict})'
                        for item in diagnosis.findings)
    motion = _next_motion(job, estimated, diagnosis)
    lines = [wording.verdict(diagnosis), *filter(None, [ranking, motion]),
             f'{len(samples)} slow samples, {time.monotonic() - start:.1f} s']
    return ' | '.join(lines)


def _next_motion(job: Job, estimated: Estimate, diagnosis: Diagnosis) -> str:
    """Return the motion that resolves open findings as text; empty if there is none."""
    if job.model is None:
        return ''
    try:
        planned = plan(job.rows.samples, job.model, diagnosis=diagnosis, estimated=estimated)
    except GravityCompError:
        return ''
    parts = '; '.join(part.sentence for part in planned.parts)
    return (f'to resolve open findings, move for {planned.trajectory.duration:.0f} s: {parts} '
            f'(`gravity_comp plan` on a recording writes that motion)')


def run_payload_test(job: Job) -> PayloadResult:
    """Return whether the samples show another payload."""
    samples, model = job.rows.samples, job.model
    assert model is not None
    chain = _chains.of(model, job.geometry)
    if chain is None:
        return PayloadResult('the effort has changed; a payload cannot be tested, because no '
                             'serial chain explains this arm', is_other=True)
    (gravity, friction), noise = without_effects(model, samples), residual_noise(model)
    change = gravity.tau - model.predict(gravity.q)
    tables = Window(gravity, friction, model, chain, noise,
                    reference_noise(expected_residual(model), gravity, change), job.settings,
                    axes_under(chain, job.geometry)).tables()
    present, other = acceptance.suspicion_checks(tables[0])
    other = [*acceptance.body_checks(tables, (tables[0].push(), tables[0].varying())), *other]
    every, residual = (*present, *other), rms(change)
    k = int(np.argmax(residual / noise))
    figures = (f'residual of {samples.names[k]} {residual[k]:.3g} N·m, noise of the training '
               f'{noise[k]:.3g}, {len(samples)} samples in {samples.t[-1] - samples.t[0]:.1f} s')
    values = {'joint': samples.names[k], 'residual [Nm]': f'{residual[k]:.3g}',
              'noise of the training [Nm]': f'{noise[k]:.3g}', 'samples': str(len(samples)),
              'from [s]': f'{samples.t[0]:.3f}', 'to [s]': f'{samples.t[-1]:.3f}',
              'log evidence': f'{present[0].statistic:.1f}'}
    what = 'a body'
    if (body := tables[0].body()) is not None:
        what = f'a change of {body[0]:.3g} kg'
        values |= {'mass [kg]': f'{body[0]:.3g}',
                   'standard deviation of the mass [kg]': f'{body[1]:.2g}'}
    # A push or a varying force that is as likely as a body is no reason for an alarm.
    ambiguous = any(0.0 <= check.statistic < check.limit for check in other
                    if check.name in (checks.NO_PUSH, checks.NOT_VARYING))
    if checks.failed(present) is not None or ambiguous:
        return PayloadResult(f'no payload is suspected: {figures}', every, values)
    if (refusal := checks.failed(other)) is not None:
        return PayloadResult('the effort has changed in a way that no payload explains: '
                             f'{refusal.text}; {figures}', every, values, is_other=True)
    return PayloadResult(
        f'another payload is suspected: {what} on the last link explains at least '
        f'{present[1].statistic:.0%} of each third of the samples; {figures}', every, values)


def run_fit(job: Job) -> FitResult:
    """
    Fit a job, compare the best candidate with the model in use, and check it.

    With few samples and a base only the change of the base is fitted. With more samples a full
    fit is a candidate as well, and the held-out error decides. A request for effects that the
    base does not have requires a full fit.

    :raises FitError: if there is no result, or there are too few samples for the effects.
    :raises DataError: if the samples do not excite a requested effect.
    """
    if job.base is not None:
        return _compared_fit(job)
    job, check = acceptance.first_samples(job)
    try:
        result = _compared_fit(job)
    except (FitError, DataError) as error:
        if check.passed:
            raise
        raise DataError(check.text) from error
    text = f'{check.text}; ' * bool(check.text and check.passed)
    return replace(result, checks=(check, *result.checks), figures=text + result.figures)


def _compared_fit(job: Job) -> FitResult:
    start = time.monotonic()
    chain = None if job.base is None else _chains.of(job.base, job.geometry)
    tried, samples = list[Candidate](), job.rows.samples
    # Outliers have a transient torque, such as that of an intermittent brake. They are those of
    # the change of the base, which must not be fitted to them. They have little weight in a full
    # fit.
    base = chain or job.base
    if job.base is not None and base is not None and base.energy is not None:
        outlying = outliers_of_change(without_effects(job.base, samples)[0], base)
    else:
        tried = list(candidates(job, None))
        outlying = outliers_of_fit(tried[0].residual(samples), samples)
    left_out = {name: int(n) for name, n in zip(samples.names, outlying.sum(axis=0)) if n}
    job = replace(job, rows=job.rows.select(~np.asarray(outlying.any(axis=1))))
    tried = [candidate(each.model, job, each.how, each.fit)
             for each in tried] or list(candidates(job, chain))
    best = _best(tried, job)
    old = None if job.model is None else candidate(job.model, job)
    comparison = compare(best, old, job.rows, old is not None and len(
        job.rows.train) > old.model.coverage.n_samples)
    judged = list(comparison.checks)
    if not comparison.is_compensated:
        judged = [*_checks(job, chain, best), *judged]
        if checks.failed(judged) is None and best.fit is not None:
            judged.append(_converged(best.fit, job))
    figures = comparison.figures
    if len(tried) > 1:
        errors = ((each.how, rms(held_out_rmse(each.residual(job.rows.samples), job.rows)))
                  for each in tried)
        figures += '; tried: ' + ', '.join(f'{how} {error:.3g} N·m' for how, error in errors)
    return FitResult(best.model, tuple(judged), figures, best.how, time.monotonic() - start,
                     Coverage.of(job.rows.train), left_out, comparison.is_compensated)


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
    source, allowance = (model, OPTIONS.new_effects) if has_new_effects else (base, 1.0)
    gravity, friction = without_effects(source, samples)
    before = base.predict(gravity.q)
    noise = allowance * reference_noise(expected_residual(base), gravity, gravity.tau - before)
    if chain is None:
        yield acceptance.gravity_present(gravity, before, noise)
        yield acceptance.joints_agree(samples, residual, (
            noise, rms(best.torque - predict_torque(base, samples))))
        return
    yield from acceptance.body_checks(
        Window(gravity, friction, base, chain, noise, noise, job.settings,
               axes_under(chain, job.geometry)).tables())


def _converged(fit: FullFit, job: Job) -> Check:
    options = options_of(job)
    why = convergence_objection(fit.model, job.rows.train, residual_noise(fit.model),
                                lambda part: fit_again(part, fit, options).model)
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
    if outliers.any(axis=1).mean() > OPTIONS.max_outliers:
        return np.zeros_like(outliers)
    return outliers


def _best(tried: list[Candidate], job: Job) -> Candidate:
    """
    Return the first candidate unless a later one has a smaller held-out error by a margin.

    A change of the old model extrapolates best, then a chain, then a potential. The margins
    exceed the statistical uncertainty of the error.
    """
    best, *others = tried
    for other in others:
        margin = OPTIONS.full_fit_margin if best.fit is None else OPTIONS.sparse_margin
        if compare(other, best, job.rows, margin=margin).is_better:
            best = other
    return best


def without_effects(model: GravityModel, samples: JointSamples
                    ) -> tuple[JointSamples, FloatArray]:
    """Return samples without the effects and nuisance terms of a model, and these (M, N), N·m."""
    others = effect_torque(model, samples) + fitted_torque(model, samples)
    return replace(samples, tau=samples.tau - others), others
