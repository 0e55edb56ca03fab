"""
Jobs of the fit process: the only module of the node that calls the learning half.

It fits candidate models, diagnoses and plans with `estimation`, `diagnosis` and `planning`, and
leaves the decision about a result to `acceptance`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
import time

from gravity_comp_ros.data.runs import in_one_run
from gravity_comp_ros.data.samples import BoolArray, concatenate, FloatArray, JointSamples
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.effects.predict import effect_torque, predict_torque
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError, FitError, GravityCompError, ModelMismatchError
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.fit_with_effects import fit_with_effects
from gravity_comp_ros.estimation.nuisance_columns import nuisance_torque
from gravity_comp_ros.estimation.payload_estimate import on_known_axes
from gravity_comp_ros.estimation.payload_path import payload_path
from gravity_comp_ros.estimation.subset_stability import convergence_objection
from gravity_comp_ros.estimation.update import payload_change_weights, update
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import fit_chain
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.models.nuisance import INERTIA
from gravity_comp_ros.models.uncertainty import ChainUncertainty
from gravity_comp_ros.node import acceptance, checks
from gravity_comp_ros.node.acceptance import compare, Prediction, reference_noise
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.hypotheses import Hypotheses
from gravity_comp_ros.node.job_messages import (
    AnyJob, AnyResult, DiagnosisJob, DiagnosisResult, FitJob, FitResult, PayloadJob, PayloadResult)
from gravity_comp_ros.node.slow_samples import (
    expected_residual, moving_rms, residual_noise, REST_SPEED, rms)
from gravity_comp_ros.planning.plan import plan
from gravity_comp_ros.worker.serve import ProgressCallback, Work
import numpy as np

# Minimum number of training samples of a full fit. With fewer it overfits and extrapolates badly;
# the change of an old model requires a fraction of them (docs/node.md).
MIN_FULL_FIT_SAMPLES = 100
# Kind of a fit, as in replies and diagnostics.
CHANGE, FULL_FIT = 'change of the old model', 'full fit'
SPARSE = f'{FULL_FIT}, potential'
# Margin of the held-out error by which a sparse potential must beat a chain, and a full fit a
# change of the old model. On about thirty held-out samples a model that was wrong at other poses
# was better by a tenth.
_SPARSE_MARGIN, _FULL_FIT_MARGIN = 0.1, 0.25
# Factor of the noise of earlier epochs where gravity is fitted jointly with new effects.
NEW_EFFECTS_FACTOR = 2.0
# Largest share of outliers. A larger share means that the model or the effort is wrong.
MAX_OUTLIERS = 0.3
# Number of poses drawn from the trained range for a chain, and of those with the smallest
# standard deviation; largest RMS error of the chain in units of the model's noise.
_DRAWN, _KEPT, _MAX_ERROR = 600, 200, 1.0
# A candidate model, with how it was fitted.
Candidate = tuple[str, GravityModel]


def fitting() -> Work:
    """Return the function that runs the jobs of the node."""
    return run_job


def run_job(job: AnyJob, _: ProgressCallback) -> AnyResult:
    """Run a job of any kind."""
    if isinstance(job, DiagnosisJob):
        return run_diagnosis(job)
    return run_payload_test(job) if isinstance(job, PayloadJob) else run_fit(job)


def run_diagnosis(job: DiagnosisJob) -> DiagnosisResult:
    """
    Return the findings of a diagnosis, and the motion that resolves the open ones, as text.

    :raises DataError: if there are too few samples.
    """
    start = time.monotonic()
    diagnosis = diagnose(job.samples, job.model)
    # Named as `gravity_comp add` and the parameter `effects` accept them.
    ranking = ', '.join(f'{target(item.effect or "unexplained", item.joint)} ({item.verdict})'
                        for item in diagnosis.findings)
    lines = [wording.verdict(diagnosis), *filter(None, [ranking, _next_motion(job, diagnosis)]),
             f'{len(job.samples)} slow samples, {time.monotonic() - start:.1f} s']
    return DiagnosisResult(job.number, ' | '.join(lines))


def _next_motion(job: DiagnosisJob, diagnosis: Diagnosis) -> str:
    """Return the motion that resolves open findings as text; empty if there is none."""
    if job.model is None:
        return ''
    try:
        planned = plan(job.samples, job.model, diagnosis=diagnosis)
    except GravityCompError:
        return ''
    parts = '; '.join(part.sentence for part in planned.parts)
    return (f'to resolve open findings, move for {planned.trajectory.duration:.0f} s: {parts} '
            f'(`gravity_comp plan` on a recording writes that motion)')


def run_payload_test(job: PayloadJob) -> PayloadResult:
    """Return whether the samples show another payload."""
    samples, model, since = job.samples, job.model, float(job.samples.t[0])
    chain = _chains.of(model, job.geometry)
    if chain is None or chain.joints != samples.names:
        return PayloadResult(job.number, False, True, 'the effort has changed; a payload cannot '
                             'be tested, because no serial chain explains this arm', since)
    others = effect_torque(model, samples) + nuisance_torque(model.nuisance, samples)
    gravity, noise = without_torque(model, samples, others), residual_noise(model)
    table = Hypotheses(gravity, others, model, chain, noise, job.payload,
                       axes_under(chain, job.geometry))
    reference = reference_noise(expected_residual(model), gravity, table.before)
    present, other = acceptance.suspicion_checks(table)
    other = [*acceptance.body_checks(table, reference, reference / noise, job.payload), *other]
    ratio = np.sqrt(((gravity.tau - table.before) ** 2).mean(axis=0)) / noise
    k = int(np.argmax(ratio))
    figures = (f'residual of {samples.names[k]} {ratio[k] * noise[k]:.3g} N·m, noise of the '
               f'training {noise[k]:.3g}, {len(samples)} samples in '
               f'{samples.t[-1] - samples.t[0]:.1f} s')
    body = table.body_of(table.explain(table.body))
    values = {'joint': samples.names[k], 'residual [Nm]': f'{ratio[k] * noise[k]:.3g}',
              'noise of the training [Nm]': f'{noise[k]:.3g}', 'samples': str(len(samples)),
              'from [s]': f'{since:.3f}', 'to [s]': f'{samples.t[-1]:.3f}',
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
        return PayloadResult(job.number, False, False, f'no payload is suspected: {figures}',
                             since, every, values)
    if (refusal := checks.failed(other)) is not None:
        return PayloadResult(
            job.number, False, True, 'the effort has changed in a way that no payload explains: '
            f'{refusal.text}; {figures}', since, every, values)
    return PayloadResult(
        job.number, True, False, f'another payload is suspected: {what} on the last link explains '
        f'at least {present[1].statistic:.0%} of each third of the samples; {figures}', since,
        every, values)


def run_fit(job: FitJob) -> FitResult:
    """
    Fit a job, compare the best candidate with the model in use, and check it.

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
    comparison = compare(prediction, None if job.old is None else predicted(job.old, job),
                         job.train, job.held_out, job.old is not None
                         and len(job.train) > job.old.coverage.n_samples)
    judged = list(comparison.checks)
    if not comparison.is_compensated:
        judged = [*_checks(job, chain, model, prediction), *judged]
        if checks.failed(judged) is None and how != CHANGE:
            judged.append(_converged(model, job))
    figures = comparison.figures
    if len(candidates) > 1:
        figures += f'; tried: {_candidate_errors(candidates, job)}'
    return FitResult(job.number, job.epoch, model, tuple(judged), figures, how,
                     time.monotonic() - start, job.train.q.min(axis=0), job.train.q.max(axis=0),
                     left_out, comparison.is_compensated)


def _checks(job: FitJob, chain: GravityModel | None, model: GravityModel,
            prediction: Prediction) -> Iterator[Check]:
    """Yield the checks of the samples themselves: an echo, faulty effort, payload limits."""
    base = job.base
    has_new_effects = base is not None and _targets(model) != _targets(base)
    if job.sent is not None:
        echo = acceptance.not_output(job.sent, job.train, job.held_out, prediction,
                                     has_new_effects)
        if echo is not None:
            yield echo
    residual = np.maximum(*(
        moving_rms(np.where(outliers_of_fit(error, part), 0.0, error), part.qd)
        for part, error in zip((job.train, job.held_out),
                               prediction.residuals(job.train, job.held_out))))
    if base is None or base.joints != job.train.names:
        yield acceptance.joints_agree(job.train, residual)
        return
    # With other effects gravity changes without a change of the payload.
    source, allowance = (model, NEW_EFFECTS_FACTOR) if has_new_effects else (base, 1.0)
    gravity, friction = _gravity_samples(source, job)
    before = base.predict(gravity.q)
    noise = allowance * reference_noise(expected_residual(base), gravity, before)
    if chain is None or chain.joints != job.train.names:
        yield acceptance.gravity_present(gravity, before, noise)
        yield acceptance.change_without_chain(
            job.train, residual, noise, rms(prediction.train - predict_torque(base, job.train)))
        return
    table = Hypotheses(gravity, friction, base, chain, noise, job.payload,
                       axes_under(chain, job.geometry))
    yield from acceptance.body_checks(table, noise, 1.0, job.payload)


def _converged(model: GravityModel, job: FitJob) -> Check:
    options = FitOptions(model.formulation,
                         geometry=job.geometry if model.geometry is not None else None)
    why = convergence_objection(model, job.train, residual_noise(model),
                                lambda early: full_fit(replace(job, train=early), options))
    return Check(checks.CONVERGED, float(why is not None), 0.5, text=why or '')


def _without_outliers(job: FitJob, chain: GravityModel | None
                      ) -> tuple[FitJob, Mapping[str, int], Candidate | None]:
    """
    Return the job without outliers, their number per joint, and the model that identified them.

    Outliers are samples with a transient torque, such as that of an intermittent brake. With a
    chain they are those of its change. Without one they are those of a full fit, which is
    returned if it is a candidate of the remaining job.
    """
    first = None
    if chain is not None and chain.joints == job.train.names:
        gravity, _ = _gravity_samples(job.base or chain, job)
        is_outlier = outliers_of_change(gravity, chain)
    else:
        try:
            how, model = next(_full_fits(replace(job, effects=())))
        except (FitError, DataError):
            return job, {}, None
        samples = concatenate((job.train, job.held_out))
        is_outlier = outliers_of_fit(np.concatenate(
            predicted(model, job).residuals(job.train, job.held_out)), samples)
        first = None if job.effects else (how, model)
    if not is_outlier.any():
        return job, {}, first
    keep: BoolArray = ~np.asarray(is_outlier.any(axis=1))
    train, held_out = keep[:len(job.train)], keep[len(job.train):]
    sent = job.sent and replace(job.sent, train=job.sent.train[train],
                                held_out=job.sent.held_out[held_out])
    counts = {name: int(n) for name, n in zip(job.train.names, is_outlier.sum(axis=0)) if n}
    return replace(job, train=job.train.select(train), held_out=job.held_out.select(held_out),
                   sent=sent), counts, None


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
        if compare(prediction, best, job.train, job.held_out, margin=margin).is_better:
            how, model, best = name, other, prediction
    return how, model, best


def _candidate_errors(candidates: list[Candidate], job: FitJob) -> str:
    """Return the held-out RMSE of each candidate over all joints as text."""
    texts = []
    for how, model in candidates:
        _, error = predicted(model, job).residuals(job.train, job.held_out)
        texts.append(f'{how} {rms(moving_rms(error, job.held_out.qd)):.3g} N·m')
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
    samples = replace(job.train, tau=job.train.tau - effect_torque(base, job.train))
    yield CHANGE, update(base, samples, geometry=base.geometry).model
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


def interleaved_nuisance(model: GravityModel, train: JointSamples,
                         held_out: JointSamples) -> tuple[FloatArray, FloatArray]:
    """
    Return nuisance torque (M, N) in N·m at interleaved training and held-out samples.

    The direction of friction at rest follows from the path of the joint, so both sets are
    evaluated together in order of time.
    """
    both = concatenate((train, held_out))
    order = np.argsort(both.t, kind='stable')
    if (np.diff(both.t[order]) <= 0.0).any():
        return (nuisance_torque(model.nuisance, train),
                nuisance_torque(model.nuisance, held_out))
    torque = np.empty_like(both.tau)
    torque[order] = nuisance_torque(model.nuisance, in_one_run(both, order))
    return torque[:len(train)], torque[len(train):]


def without_torque(model: GravityModel, samples: JointSamples,
                   torque: FloatArray) -> JointSamples:
    """
    Return the samples minus a torque (M, N) in N·m that includes a model's nuisance terms.

    If the model has inertia terms, the rest has no inertia: the accelerations are then 0.
    """
    qdd = np.zeros_like(samples.q) if model.nuisance.of(INERTIA) else samples.qdd
    return replace(samples, tau=samples.tau - torque, qdd=qdd)


def _gravity_samples(model: GravityModel, job: FitJob) -> tuple[JointSamples, FloatArray]:
    """Return all samples without the effects and nuisance terms of a model, and these (M, N)."""
    both = concatenate((job.train, job.held_out))
    torque = effect_torque(model, both) + np.concatenate(
        interleaved_nuisance(model, job.train, job.held_out))
    return without_torque(model, both, torque), torque


def _targets(model: GravityModel) -> set[str]:
    return {effect.target for effect in model.applied.effects}


def axes_under(model: GravityModel, geometry: Geometry | None) -> Geometry | None:
    """Return the axes of a chain, its own or those described; None if it has neither."""
    for axes in (model.geometry, geometry):
        if axes is not None and model.chain is not None and model.joints == axes.joints and (
                np.abs(model.chain.axes[1:] - axes.rotations[1:]).max(initial=0.0) < 1e-6):
            return axes
    return None


class BaseChains:
    """
    Converts models to chains, against which a change is tested; keeps the last one.

    A potential model of a serial arm and its chain predict the same torque. A chain fitted to the
    torque of a potential model, at the poses with the smallest standard deviation, separates the
    gravity of that model by links.
    """

    def __init__(self) -> None:
        self._key: bytes = b''
        self._chain: GravityModel | None = None

    def of(self, model: GravityModel, geometry: Geometry | None) -> GravityModel | None:
        """Return the gravity of a model as a chain, None where no chain explains it."""
        parts = [part for torque in model.torques for part in (torque.indices, torque.weights)]
        if geometry is not None:
            parts += [geometry.rotations, geometry.origins]
        key = b'|'.join(np.ascontiguousarray(part).tobytes() for part in parts)
        if key != self._key:
            self._key, self._chain = key, as_chain(model, geometry)
        return self._chain


_chains = BaseChains()


def as_chain(model: GravityModel, geometry: Geometry | None = None) -> GravityModel | None:
    """
    Return the gravity of a model as a chain model of the same joints in the same order.

    :param geometry: axes of the arm where they are known; the chain then has these axes.
    """
    if geometry is not None and geometry.joints == model.joints:
        with suppress(ModelMismatchError, np.linalg.LinAlgError):
            return _chain_model(model, *on_known_axes(model, geometry))
    if model.chain is not None and model.uncertainty is not None:
        return model
    if model.uncertainty is None:
        return None
    rng = np.random.default_rng(0)
    q = rng.uniform(model.coverage.q_min, model.coverage.q_max, (_DRAWN, model.n_joints))
    noise = np.maximum(model.noise, 1e-3 * float(model.noise.max()) + 1e-9)
    q = q[np.argsort((model.predict_std(q) / noise).max(axis=1))[:_KEPT]]
    torque = model.predict(q)
    samples = JointSamples.single_run(
        model.joints, np.arange(len(q)), q, np.zeros_like(q),
        torque + noise * rng.standard_normal(q.shape))
    try:
        result = fit_chain(samples)
    except (FitError, DataError, np.linalg.LinAlgError):
        return None
    if (rms(result.chain.torque(q) - torque) > _MAX_ERROR * noise).any():
        return None
    return _chain_model(model, result.chain, result.covariance)


def _chain_model(model: GravityModel, chain: Chain, covariance: FloatArray,
                 geometry: Geometry | None = None) -> GravityModel:
    result = GravityModel.from_energy(
        model.joints, 'chain', expand(chain), model.noise, model.coverage, model.provenance,
        chain, ChainUncertainty(chain, covariance))
    return replace(result, applied=model.applied, history=model.history, nuisance=model.nuisance,
                   payload_path=model.payload_path, geometry=geometry)
