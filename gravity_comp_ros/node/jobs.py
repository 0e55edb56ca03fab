"""
Jobs of the fit process: the only module of the node that calls the learning half.

It fits candidate models, diagnoses and plans with `estimation`, `diagnosis` and `planning`, and
leaves the decision about a result to `acceptance`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
import time

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import conclude
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.predict import effect_torque, fitted_torque, predict_torque
from gravity_comp_ros.errors import DataError, FitError, GravityCompError
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.chain_of_model import axes_under, ChainOfModel
from gravity_comp_ros.estimation.chain_update import NewSamples, Trial
from gravity_comp_ros.estimation.estimate import Estimate, estimate, FitOptions
from gravity_comp_ros.estimation.fit import fit_again, FitResult as FullFit
from gravity_comp_ros.estimation.refit import fit_options_of
from gravity_comp_ros.estimation.subset_stability import convergence_objection
from gravity_comp_ros.estimation.update import payload_change_weights
from gravity_comp_ros.estimation.update_step import changed_model
from gravity_comp_ros.evaluation.expected_residual import expected_residual, residual_noise, rms
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.models.uncertainty import ChainUncertainty
from gravity_comp_ros.node import acceptance, checks, first_samples
from gravity_comp_ros.node.acceptance import reference_noise
from gravity_comp_ros.node.candidates import (
    Candidate, candidates, full_fit, options_of, predicted)
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.comparison import compare, not_output
from gravity_comp_ros.node.epoch import REST_SPEED
from gravity_comp_ros.node.hypotheses import Hypotheses, moving_rms
from gravity_comp_ros.node.job_messages import (
    AnyJob, AnyResult, DiagnosisJob, FitJob, FitResult, PayloadJob, PayloadResult)
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.worker.serve import ProgressCallback, Work
import numpy as np

# Margin of the held-out error by which a sparse potential must beat a chain, and a full fit a
# change of the old model. On about thirty held-out samples a model that was wrong at other poses
# was better by a tenth.
_SPARSE_MARGIN, _FULL_FIT_MARGIN = 0.1, 0.25
# Factor of the noise of earlier epochs where gravity is fitted jointly with new effects.
NEW_EFFECTS_FACTOR = 2.0
# Largest share of outliers. A larger share means that the model or the effort is wrong.
MAX_OUTLIERS = 0.3
_chains = ChainOfModel()


def fitting() -> Work:
    """Return the function that runs the jobs of the node."""
    return run_job


def run_job(job: AnyJob, _: ProgressCallback) -> AnyResult:
    """Run a job of any kind."""
    if isinstance(job, DiagnosisJob):
        return run_diagnosis(job)
    return run_payload_test(job) if isinstance(job, PayloadJob) else run_fit(job)


def run_diagnosis(job: DiagnosisJob) -> str:
    """
    Return the findings of a diagnosis, and the motion that resolves the open ones, as text.

    :raises DataError: if there are too few samples.
    """
    start = time.monotonic()
    options = FitOptions() if job.model is None else fit_options_of(job.model)
    estimated = estimate(job.samples, options, old=job.model)
    diagnosis = conclude(estimated, job.model)
    # Named as `gravity_comp add` and the parameter `effects` accept them.
    ranking = ', '.join(f'{target(item.effect or "unexplained", item.joint)} ({item.verdict})'
                        for item in diagnosis.findings)
    motion = _next_motion(job, estimated, diagnosis)
    lines = [wording.verdict(diagnosis), *filter(None, [ranking, motion]),
             f'{len(job.samples)} slow samples, {time.monotonic() - start:.1f} s']
    return ' | '.join(lines)


def _next_motion(job: DiagnosisJob, estimated: Estimate, diagnosis: Diagnosis) -> str:
    """Return the motion that resolves open findings as text; empty if there is none."""
    if job.model is None:
        return ''
    try:
        planned = plan(job.samples, job.model, diagnosis=diagnosis, estimated=estimated)
    except GravityCompError:
        return ''
    parts = '; '.join(part.sentence for part in planned.parts)
    return (f'to resolve open findings, move for {planned.trajectory.duration:.0f} s: {parts} '
            f'(`gravity_comp plan` on a recording writes that motion)')


def run_payload_test(job: PayloadJob) -> PayloadResult:
    """Return whether the samples show another payload."""
    samples, model = job.samples, job.model
    chain = _chains.of(model, job.geometry)
    if chain is None:
        return PayloadResult(False, True, 'the effort has changed; a payload cannot '
                             'be tested, because no serial chain explains this arm')
    (gravity, others), noise = without_effects(model, samples), residual_noise(model)
    every_table = tables(gravity, others, model, chain, noise, job.settings,
                         axes_under(chain, job.geometry))
    table = every_table[0]
    reference = reference_noise(expected_residual(model), gravity, table.before)
    present, other = acceptance.suspicion_checks(table)
    other = [*acceptance.body_checks(every_table, reference, reference / noise, job.settings,
                                     (table.push(), table.varying())), *other]
    ratio = np.sqrt(((gravity.tau - table.before) ** 2).mean(axis=0)) / noise
    k = int(np.argmax(ratio))
    figures = (f'residual of {samples.names[k]} {ratio[k] * noise[k]:.3g} N·m, noise of the '
               f'training {noise[k]:.3g}, {len(samples)} samples in '
               f'{samples.t[-1] - samples.t[0]:.1f} s')
    body = table.carried_body()
    values = {'joint': samples.names[k], 'residual [Nm]': f'{ratio[k] * noise[k]:.3g}',
              'noise of the training [Nm]': f'{noise[k]:.3g}', 'samples': str(len(samples)),
              'from [s]': f'{samples.t[0]:.3f}', 'to [s]': f'{samples.t[-1]:.3f}',
              'log evidence': f'{present[0].statistic:.1f}'}
    if body is not None:
        values |= {'mass [kg]': f'{body[0]:.3g}',
                   'standard deviation of the mass [kg]': f'{body[1]:.2g}'}
    what = 'a body' if body is None else f'a change of {body[0]:.3g} kg'
    every = (*present, *other)
    # A push or a varying force that is as likely as a body is no reason for an alarm.
    ambiguous = any(0.0 <= check.statistic < check.limit for check in other
                    if check.name in (checks.NO_PUSH, checks.NOT_VARYING))
    if checks.failed(present) is not None or ambiguous:
        return PayloadResult(False, False, f'no payload is suspected: {figures}', every, values)
    if (refusal := checks.failed(other)) is not None:
        return PayloadResult(
            False, True, 'the effort has changed in a way that no payload explains: '
            f'{refusal.text}; {figures}', every, values)
    return PayloadResult(
        True, False, f'another payload is suspected: {what} on the last link explains '
        f'at least {present[1].statistic:.0%} of each third of the samples; {figures}', every,
        values)


def run_fit(job: FitJob) -> FitResult:
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
    job, check = first_samples.judged(job)
    try:
        result = _compared_fit(job)
    except (FitError, DataError) as error:
        if check.passed:
            raise
        raise DataError(check.text) from error
    text = f'{check.text}; ' * bool(check.text and check.passed)
    return replace(result, checks=(check, *result.checks), figures=text + result.figures)


def _compared_fit(job: FitJob) -> FitResult:
    start = time.monotonic()
    chain = None if job.base is None else _chains.of(job.base, job.geometry)
    job, left_out, first = _without_outliers(job, chain)
    tried = list(candidates(job, chain, first))
    best = _best(tried, job)
    comparison = compare(best.predicted, None if job.old is None else predicted(job.old, job),
                         job.rows, job.old is not None
                         and len(job.rows.train) > job.old.coverage.n_samples)
    judged = list(comparison.checks)
    if not comparison.is_compensated:
        judged = [*_checks(job, chain, best), *judged]
        if checks.failed(judged) is None and best.fit is not None:
            judged.append(_converged(best.fit, job))
    figures = comparison.figures
    if len(tried) > 1:
        figures += f'; tried: {_errors(tried, job)}'
    q = job.rows.train.q
    return FitResult(best.model, tuple(judged), figures, best.how,
                     time.monotonic() - start, q.min(axis=0), q.max(axis=0), left_out,
                     comparison.is_compensated)


def _checks(job: FitJob, chain: GravityModel | None, best: Candidate) -> Iterator[Check]:
    """Yield the checks of the samples themselves: an echo, faulty effort, payload limits."""
    base, samples, model, prediction = job.base, job.rows.samples, best.model, best.predicted
    has_new_effects = base is not None and _targets(model) != _targets(base)
    echo = not_output(job.rows, prediction, has_new_effects)
    if echo is not None:
        yield echo
    error = prediction.residual(samples)
    residual = np.maximum(*(
        moving_rms(np.where(outliers_of_fit(error[part], samples.select(part)), 0.0, error[part]),
                   samples.qd[part]) for part in (job.rows.held_out, ~job.rows.held_out)))
    if base is None:
        yield acceptance.joints_agree(job.rows.train, residual)
        return
    # With other effects gravity changes without a change of the payload.
    source, allowance = (model, NEW_EFFECTS_FACTOR) if has_new_effects else (base, 1.0)
    gravity, friction = without_effects(source, samples)
    before = base.predict(gravity.q)
    noise = allowance * reference_noise(expected_residual(base), gravity, before)
    if chain is None:
        yield acceptance.gravity_present(gravity, before, noise)
        yield acceptance.joints_agree(samples, residual, (
            noise, rms(prediction.torque - predict_torque(base, samples))))
        return
    yield from acceptance.body_checks(
        tables(gravity, friction, base, chain, noise, job.settings,
               axes_under(chain, job.geometry)), noise, 1.0, job.settings)


def tables(gravity: JointSamples, friction: FloatArray, model: GravityModel,
           chain: GravityModel, noise: FloatArray, limits: Parameters,
           geometry: Geometry | None) -> list[Hypotheses]:
    """
    Return the explanations of a window, the table of the most probable body first.

    The direction of an axis that carried nothing before is not identified. Each direction that a
    sparse update finds probable has a table of its own.

    :param chain: the gravity of the model as a chain of the same joints.
    """
    assert chain.chain is not None
    n = chain.n_joints
    covariance = chain.uncertainty.covariance if isinstance(
        chain.uncertainty, ChainUncertainty) else np.zeros((4 * n, 4 * n))
    trials = [Trial(chain.chain, covariance)]
    if geometry is None:
        weights = payload_change_weights(chain, gravity)
        trials += changed_model(chain, NewSamples(gravity.q, gravity.tau, noise, weights),
                                None).trials
    result = [Hypotheses(gravity, friction, model, trial.chain, trial.prior, noise, limits,
                         geometry, trial.price) for trial in trials]
    return sorted(result, key=lambda table: -table.carried.log_evidence)


def _converged(fit: FullFit, job: FitJob) -> Check:
    options = options_of(job)
    why = convergence_objection(fit.model, job.rows.train, residual_noise(fit.model),
                                lambda part: fit_again(part, fit, options).model)
    return Check(checks.CONVERGED, float(why is not None), 0.5, text=why or '')


def _without_outliers(job: FitJob, chain: GravityModel | None
                      ) -> tuple[FitJob, Mapping[str, int], FullFit | None]:
    """
    Return the job without outliers, their number per joint, and the fit that identified them.

    Outliers are samples with a transient torque, such as that of an intermittent brake. With a
    chain they are those of its change. Without one they are those of a full fit, which gives them
    little weight (`huber_weights`) and is returned if it is a candidate of the job.
    """
    first, samples = None, job.rows.samples
    if chain is not None:
        gravity, _ = without_effects(job.base or chain, samples)
        is_outlier = outliers_of_change(gravity, chain)
    else:
        try:
            first = full_fit(replace(job, settings=replace(job.settings, effects=())))
        except (FitError, DataError):
            return job, {}, None
        is_outlier = outliers_of_fit(predicted(first.model, job).residual(samples), samples)
    first = None if job.settings.effects else first
    if not is_outlier.any():
        return job, {}, first
    counts = {name: int(n) for name, n in zip(samples.names, is_outlier.sum(axis=0)) if n}
    keep: BoolArray = ~np.asarray(is_outlier.any(axis=1))
    return replace(job, rows=job.rows.select(keep)), counts, first


def outliers_of_change(gravity: JointSamples, chain: GravityModel) -> BoolArray:
    """Return a mask (M, N) of the torques that are outliers of a change of the chain's moments."""
    return _none_if_too_many(payload_change_weights(chain, gravity) == 0.0)


def outliers_of_fit(residual: FloatArray, samples: JointSamples) -> BoolArray:
    """
    Return a mask (M, N) of the torques that are outliers of a model that was fitted to them.

    At rest friction can have any value, so a joint at rest has no outliers.

    :param residual: residual without friction and offset (M, N), N·m.
    """
    far = robust.huber_weights(residual, floor(samples.tau)) == 0.0
    return _none_if_too_many(far & (np.abs(samples.qd) > REST_SPEED))


def _none_if_too_many(outliers: BoolArray) -> BoolArray:
    if outliers.any(axis=1).mean() > MAX_OUTLIERS:
        return np.zeros_like(outliers)
    return outliers


def _best(tried: list[Candidate], job: FitJob) -> Candidate:
    """
    Return the first candidate unless a later one has a smaller held-out error by a margin.

    A change of the old model extrapolates best, then a chain, then a potential. The margins
    exceed the statistical uncertainty of the error.
    """
    best, *others = tried
    for other in others:
        margin = _FULL_FIT_MARGIN if best.fit is None else _SPARSE_MARGIN
        if compare(other.predicted, best.predicted, job.rows, margin=margin).is_better:
            best = other
    return best


def _errors(tried: list[Candidate], job: FitJob) -> str:
    """Return the held-out RMSE of each candidate over all joints as text."""
    held_out, texts = job.rows.held_out, []
    for candidate in tried:
        error = candidate.predicted.residual(job.rows.samples)[held_out]
        size = rms(moving_rms(error, job.rows.samples.qd[held_out]))
        texts.append(f'{candidate.how} {size:.3g} N·m')
    return ', '.join(texts)


def without_effects(model: GravityModel, samples: JointSamples
                    ) -> tuple[JointSamples, FloatArray]:
    """Return samples without the effects and nuisance terms of a model, and these (M, N), N·m."""
    others = effect_torque(model, samples) + fitted_torque(model, samples)
    return replace(samples, tau=samples.tau - others), others


def _targets(model: GravityModel) -> set[str]:
    return {effect.target for effect in model.applied.effects}
