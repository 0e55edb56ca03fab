"""
Decisions about a model and about a payload, as lists of checks.

A new model is compared with the one in use on samples that no fit has used, and with the torque
that the node published. The same hypotheses (`hypotheses`) judge the epoch of a new model, and the
samples in which a payload is suspected. The samples of a first model are judged as a recording is:
without a model there is no reference, and neither another unit nor a wrong sign contradicts one.
The facts about a recording show them (`facts.judge`, `estimation.torque_facts`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.description.joint_order import joint_order, NAMES
from gravity_comp_ros.estimation.fit import FitResult
from gravity_comp_ros.estimation.subset_stability import last_part
from gravity_comp_ros.estimation.torque_facts import torque_facts
from gravity_comp_ros.evaluation.expected_residual import rms
from gravity_comp_ros.facts.fact import Action, Fact, Kind, refused, unless_accepted
from gravity_comp_ros.facts.judge import judge
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.facts.signals import Signals
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.noise import of_second_differences
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.checks import Check, Job
from gravity_comp_ros.node.epoch import FULL_FIT_SAMPLES, REST_SPEED, Rows
from gravity_comp_ros.node.hypotheses import Explanation, Hypotheses, moving, moving_rms
from gravity_comp_ros.node.options import CHECKS, NODE
import numpy as np

# Facts that the input shows before, at the full rate (kept samples are seconds apart), and
# outliers, which a fit reports itself.
_ELSEWHERE = (Kind.VELOCITY, Kind.GLITCHES, Kind.WRAPS, Kind.SPIKES)


def first_samples(job: Job) -> tuple[Job, Check]:
    """
    Return a job without samples that are no measurements, and the check that it can be learned.

    The text of the check has the facts. A fact about the arm that the last samples do not show is
    no fault of the effort: in little motion several arms explain it, and the model has not
    converged.
    """
    samples = job.rows.samples
    none = np.zeros(samples.n_joints, dtype=bool)
    signals = Signals(samples.names, samples.t, samples.q, samples.qd, samples.tau,
                      np.arange(len(samples)))
    judgement = judge(signals, np.ones(samples.n_joints), none, True,
                      {*job.settings.accept, *_ELSEWHERE})
    kept = np.zeros(len(samples), dtype=bool)
    kept[judgement.signals.rows] = True
    rows = job.rows.select(kept)
    seen = [fact for fact in judgement.facts if fact.action in (Action.REFUSED, Action.LEFT_OUT)]
    of_arm = _facts_of_arm(job, rows.samples)
    refusals, structural = refused(seen), refused(of_arm)
    if structural:
        last = {(fact.kind, fact.joints) for fact in _facts_of_arm(job, last_part(rows.samples))}
        refusals += [fact for fact in structural if (fact.kind, fact.joints) in last]
    if structural and not refusals:
        return replace(job, rows=rows), Check(checks.CONVERGED, 1.0, 0.5, text=(
            f'{structural[0].evidence}, but the last samples do not show it: keep moving slowly'))
    text = '; '.join(map(_sentence, refusals or [*seen, *of_arm]))
    return replace(job, rows=rows), Check(checks.NO_FACT, float(len(refusals)), 0.0, text=text)


def _facts_of_arm(job: Job, samples: JointSamples) -> list[Fact]:
    """Return the facts that one arm for all joints shows."""
    geometry, order = job.geometry, joint_order(samples.names)
    facts = torque_facts(
        samples, None if geometry is None else geometry.rotations,
        by_name=geometry is None and order.joints == samples.names
        and order.source == NAMES)
    return [unless_accepted(fact, job.settings.accept) for fact in facts]


def _sentence(fact: Fact) -> str:
    """Return evidence and action of a fact, with the parameters that lift a refusal."""
    text = f'{fact.evidence}: {fact.done}'
    if fact.action is not Action.REFUSED:
        return text
    scaled = 'effort_scale, or ' * (fact.kind in (Kind.EFFORT_UNIT, Kind.EFFORT_SIGN,
                                                  Kind.EFFORT_GAIN))
    return f'{text} (parameter {scaled}accept: [{fact.kind}] if it is right)'


def reference_noise(expected: FloatArray, samples: JointSamples,
                    residual: FloatArray) -> FloatArray:
    """
    Return the noise (N,) in N·m to compare a residual (M, N) with.

    It is the larger of the `expected` noise (N,) of earlier epochs and the noise of `samples`,
    estimated from second differences of the residual. Gravity hardly contributes to these, so a
    sensor with more noise than in the training does not prevent a payload from being accepted.
    """
    floor = CHECKS.min_noise * float(np.abs(samples.tau).max(initial=0.0)) + 1e-9
    noise = np.maximum(expected, floor)
    # Neighbours, or with one or two samples left out in between.
    near = (np.diff(samples.t) <= 3.0 * NODE.period) & (np.diff(samples.runs) == 0)
    triples = near[1:] & near[:-1]
    if triples.sum() < 5:
        return noise
    return np.maximum(noise, of_second_differences(residual, triples))


def joints_agree(samples: JointSamples, residual: FloatArray,
                 allowed: FloatArray | None = None) -> Check:
    """
    Return the check of a model against its own samples, where there is no chain to compare with.

    The torques of an arm share one potential energy. Where the effort of one joint is faulty, no
    energy explains it together with the other joints.

    :param residual: RMS residual of the model (N,), N·m.
    :param allowed: its limit (N,), N·m; None for that of a first model, by the variation of the
        effort.
    """
    if allowed is None:
        spread = samples.tau.std(axis=0)
        allowed = np.maximum(CHECKS.max_own * spread,
                             CHECKS.max_largest * float(spread.max(initial=0.0)))
    ratio = residual / np.maximum(allowed, 1e-9)
    worst = int(np.argmax(ratio))
    return Check(checks.JOINTS_AGREE, float(ratio[worst]), 1.0, text=(
        f'the effort of {samples.names[worst]} contradicts that of the other joints: residual '
        f'{residual[worst]:.3g} N·m, {allowed[worst]:.3g} N·m are allowed'))


def gravity_present(samples: JointSamples, before: FloatArray, noise: FloatArray) -> Check:
    """
    Return the check that the effort contains the gravity of the arm itself, with its sign.

    :param samples: without friction and offset.
    :param before: torque of the model before the change (M, N), N·m.
    """
    weighted = before / noise
    power = max(float((weighted ** 2).sum()), 1e-30)
    share = float((weighted * samples.tau / noise).sum()) / power
    # The standard deviation of the share, with the same error in all samples.
    std = (before.size / power) ** 0.5
    limit = CHECKS.min_gravity - CHECKS.significant * std
    return Check(checks.GRAVITY_PRESENT, share, limit, True, (
        f'the effort contains {share:.0%} of the gravity of the arm itself: drives off, gravity '
        'subtracted by the driver, or another unit or sign'))


def body_checks(tables: Sequence[Hypotheses],
                forces: Sequence[Explanation] = ()) -> Iterator[Check]:
    """
    Yield the checks of a change: a body on the last link explains it, and no fault does so better.

    :param tables: those of a window (`Window.tables`).
    :param forces: other hypotheses that a fault must explain the change better than.
    """
    table, window = tables[0], tables[0].window
    samples, names = window.samples, window.samples.names
    yield gravity_present(samples, table.before, window.reference)
    unchanged = max(each.explain().log_evidence for each in tables)
    explained = max(unchanged, *(each.log_evidence for each in (table.carried, *forces)))
    evidence, named = max(((fit.log_evidence, text) for one in tables for fit, text in one.faults()
                           if abs(fit.mean[0]) >= CHECKS.min_gain_change
                           and fit.log_evidence > unchanged
                           and one.ratio(fit).max() <= CHECKS.max_residual),
                          default=(-np.inf, ''))
    yield Check(checks.NO_FAULT, evidence - explained, CHECKS.margin, text=named)
    ratio, noise = table.ratio(table.carried), window.reference
    worst = int(np.argmax(ratio))
    yield Check(checks.BODY_EXPLAINS, float(ratio[worst]), CHECKS.max_residual, text=(
        f'no payload explains the effort of {names[worst]}: residual '
        f'{ratio[worst] * noise[worst]:.3g} N·m, noise of earlier epochs {noise[worst]:.3g}; most '
        f'likely the effort of {names[table.most_faulty()]} is frozen, saturated or that of '
        'another joint'))
    limits, known, std = window.settings, table.body(), CHECKS.significant
    if known is None:
        change = np.hypot(*table.moments.T)
        worst = int(np.argmax(change))
        largest = STANDARD_GRAVITY * limits.max_payload * limits.max_payload_reach
        yield Check(checks.WITHIN_LIMITS, float(change[worst]), largest, text=(
            f'the change at {names[worst]} is {change[worst]:.3g} N·m; the limit is '
            f'{largest:.3g} N·m, by max_payload {limits.max_payload:g} kg at max_payload_reach '
            f'{limits.max_payload_reach:g} m'))
        return
    mass, sigma, reach = known
    yield Check(checks.WITHIN_LIMITS, abs(mass), limits.max_payload + std * sigma, text=(
        f'the change is a body of {mass:.3g} kg; max_payload is {limits.max_payload:g} kg'))
    if abs(mass) > 10.0 * sigma:
        yield Check(checks.WITHIN_LIMITS, reach,
                    limits.max_payload_reach * (1.0 + std * sigma / abs(mass)), text=(
                        f'the change is a body of {mass:.3g} kg at {reach:.3g} m from the last '
                        f'joint; max_payload_reach is {limits.max_payload_reach:g} m'))


def suspicion_checks(tables: Sequence[Hypotheses]) -> list[Check]:
    """
    Return the checks of a window for a payload that was not announced.

    The first is that a body is present, the last two that it is no other force.

    :param tables: those of the window (`Window.tables`).
    """
    table = tables[0]
    body, push, varying = table.carried.log_evidence, table.push(), table.varying()
    return [
        Check(checks.BODY_PRESENT, body - table.explain().log_evidence, CHECKS.min_body, True),
        *body_checks(tables, (push, varying)),
        Check(checks.NO_PUSH, body - push.log_evidence, CHECKS.min_over_push, True,
              'something pushes or pulls the last link, not only downwards'),
        Check(checks.NOT_VARYING, body - varying.log_evidence, CHECKS.margin, True,
              'a varying force acts on the last link')]


@dataclass(frozen=True, eq=False)
class Candidate:
    """
    A model with its torque at the samples of a job (M, N), and its noise (N,), N·m.

    `nuisance` is the nuisance torque (M, N) that it was fitted with. It counts as explained, but
    not as gravity. `how` is its origin, `fit` its full fit if it is one.
    """

    model: GravityModel
    torque: FloatArray
    noise: FloatArray
    nuisance: FloatArray | float = 0.0
    how: str = ''
    fit: FitResult | None = None

    def residual(self, samples: JointSamples) -> FloatArray:
        """Return the residual (M, N) in N·m."""
        return samples.tau - self.torque - self.nuisance


def held_out_rmse(error: FloatArray, rows: Rows) -> FloatArray:
    """Return the RMS (N,) in N·m of an error (M, N) over the held-out samples in motion."""
    return moving_rms(error[rows.held_out], rows.samples.qd[rows.held_out])


def compare(new: Candidate, old: Candidate | None, rows: Rows, has_more_samples: bool = False,
            margin: float = 0.0) -> tuple[list[Check], str]:
    """
    Return the checks that `new`, fitted to the training samples, predicts the others better.

    The compared figure is the RMSE relative to the smaller one of each joint, over all joints.
    With more samples `new` may be worse by `significant` standard deviations.

    :param old: the model in use; without one `new` is compared with a constant torque.
    :param margin: fraction by which the figure of `new` must be below that of `old`.
    :return: the checks, and the errors in one line.
    """
    samples, held_out, train = rows.samples, rows.held_out, ~rows.held_out
    is_first, error_new = old is None, new.residual(samples)
    error_old = samples.tau - samples.tau[train].mean(axis=0) if old is None else old.residual(
        samples)
    rmse_new, rmse_old = (held_out_rmse(error, rows) for error in (error_new, error_old))
    floor = CHECKS.min_noise * max(1e-9, float(np.abs(samples.tau[train]).max()))
    level = np.maximum(np.minimum(rmse_new, rmse_old), floor)
    # In a few held-out seconds pose may explain much of the variance by coincidence.
    rmse = np.maximum(rmse_new, moving_rms(error_new[train], samples.qd[train]))
    noise = np.maximum(np.maximum(new.noise, new.noise if old is None else old.noise), floor)
    rise = (rmse_new - CHECKS.max_rise * rmse_old) / noise
    block = np.cumsum((np.diff(held_out, prepend=False) & held_out).astype(np.int64))[held_out]
    tolerance = -1e-9 if is_first or not has_more_samples else CHECKS.significant * ratio_std(
        (error_new / level)[held_out], (error_old / level)[held_out], samples.qd[held_out], block)
    ratio = float(rms(rmse_new / level)) / max(float(rms(rmse_old / level)), 1e-30)
    worse = ', '.join(samples.names[j] for j in np.flatnonzero(rise > 1.0))
    reference, k = 'a constant torque' if is_first else 'the old model', int(
        np.argmax(np.maximum(rmse_new, rmse_old)))
    return [*_pose_explains(samples, train, new, rmse, is_first),
            Check(checks.NO_JOINT_WORSE, float(rise.max()), 1.0, text=f'worse on {worse}'),
            Check(checks.BETTER, ratio, 1.0 + tolerance - margin, text='not better')], (
        f'held-out RMSE {rms(rmse_new):.3g} N·m, {reference} {rms(rmse_old):.3g} N·m on '
        f'{held_out.sum()} samples; worst joint {samples.names[k]} {rmse_new[k]:.3g}, '
        f'{rmse_old[k]:.3g}')


def _pose_explains(samples: JointSamples, train: BoolArray, new: Candidate, rmse: FloatArray,
                   is_first: bool) -> Iterator[Check]:
    """
    Yield the check that pose explains the effort of a joint, by the RMSE (N,) of a model in N·m.

    Otherwise, in enough motion, the arm compensates gravity itself; in less motion a first model
    has not converged.
    """
    trained = samples.q[train]
    moves = len(trained) >= FULL_FIT_SAMPLES and bool(
        (np.ptp(trained, axis=0) >= CHECKS.min_span).any())
    if is_first or moves:
        spread = np.maximum((samples.tau - new.nuisance).std(axis=0), 1e-9)
        name, text = (checks.POSE_EXPLAINS, (
            'the effort of no joint depends on pose: this arm seems to compensate gravity itself, '
            'or its axes are all vertical; nothing to learn')) if moves else (
                checks.CONVERGED, 'pose does not explain the effort yet')
        yield Check(name, float((1.0 - (rmse / spread) ** 2).max()), FactOptions().min_share, True,
                    text)


def ratio_std(new: FloatArray, old: FloatArray, qd: FloatArray, block: IntArray) -> float:
    """
    Return the standard deviation of the ratio of two RMS errors (M, N) on the same samples.

    It is that of their difference over blocks of consecutive samples, which are autocorrelated.

    :param block: number of the block of each sample (M,), from 1.
    """
    moves = moving(qd)
    squares = [(moves * error ** 2 / moves.sum(axis=0)).sum(axis=1) for error in (new, old)]
    change = np.bincount(block, squares[0] - squares[1])[1:]
    return float(np.sqrt(len(change)) * change.std(ddof=min(1, len(change) - 1))
                 / (2.0 * max(float(squares[1].sum()), 1e-30)))


def not_output(rows: Rows, new: Candidate, has_new_effects: bool = False) -> Check | None:
    """
    Return the check that the effort is not the torque that this node published.

    An arm that floats on the published torque and is guided by hand measures that torque,
    whatever its payload, and any model confirms itself. Friction is excluded: a position
    controller that adds friction torque may otherwise hide a light payload.

    :param has_new_effects: whether the new model has other effects; friction is then compared.
    :return: None where too little torque was published.
    """
    if rows.sent is None:
        return None
    known = np.isfinite(rows.sent).all(axis=(1, 2))
    if known.mean() < CHECKS.min_published_share or known.sum() < 5 or float(
            np.sqrt((rows.sent[known] ** 2).mean())) < CHECKS.min_published:
        return None
    torque, tau, qd = rows.sent[known], rows.samples.tau[known], rows.samples.qd[known]
    errors = [tau - new.torque[known], tau - torque[:, 0], tau - torque[:, 1]]
    if not has_new_effects:
        errors = [_without_friction(error, qd) for error in errors]
    spread = torque[:, 0].std(axis=0)
    counts = spread > CHECKS.min_variation * float(spread.max(initial=0.0))
    model, newest, oldest = (error[:, counts] for error in errors)
    # In slow motion torque is linear in time over the largest delay. On a busy machine the delay
    # of some samples differs, so the sizes are medians.
    echo, delay = min(
        (_median_size((1.0 - share) * newest + share * oldest), share * NODE.max_delay)
        for share in np.linspace(0.0, 1.0, NODE.delay_steps + 1))
    residual = _median_size(model)
    return Check(checks.NOT_OUTPUT, residual / max(echo, 1e-30), CHECKS.max_echo, text=(
        'the effort is the torque that this node published '
        f'{1e3 * delay:.0f} ms before: median difference {echo:.3g} N·m, '
        f'residual of the new model {residual:.3g} N·m. Either the model in use is right already, '
        'or the arm floats on that torque and is guided by hand, which gives no new data: '
        'move it by its own controller'))


def _median_size(error: FloatArray) -> float:
    """Return the median over the samples of the RMS of an error (M, N) over the joints."""
    return float(np.sqrt(np.median((error ** 2).mean(axis=1))))


def _without_friction(residual: FloatArray, qd: FloatArray) -> FloatArray:
    """Return a residual (M, N) minus its least-squares Coulomb and viscous friction."""
    result = np.empty_like(residual)
    for n in range(residual.shape[1]):
        columns = np.column_stack([np.tanh(qd[:, n] / REST_SPEED), qd[:, n]])
        result[:, n] = residual[:, n] - columns @ lstsq(columns, residual[:, n])
    return result
