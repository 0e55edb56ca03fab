"""
Decisions about a model and about a payload, as lists of checks.

The same hypotheses (`hypotheses`) judge the epoch of a new model, and the samples in which a
payload is suspected.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.noise import of_second_differences
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.hypotheses import Explanation, Hypotheses
from gravity_comp_ros.node.watch import PARTS
import numpy as np


@dataclass(frozen=True)
class AcceptanceOptions:
    """
    Limits of the checks; ratios have no unit, evidence is in nats.

    - `max_rise`: a model may raise the RMSE of no joint by more than this factor plus its noise.
    - `max_worse`: standard deviations by which a model of more samples may have a larger error on
      held-out samples: its expected error is smaller, and the figures of two equal ones differ.
    - `min_noise`: smallest noise, as a fraction of the largest torque of the samples.
    - `min_error`: smallest error and noise of a joint in a comparison of two models, as a
      fraction of the largest torque of the training samples.
    - `min_explained`: share of a joint's effort variance explained by pose below which the
      effort has no gravity, judged from the samples of a full fit and a range of `min_span` rad.
    - `max_own`, `max_largest`: residual of a first model as a fraction of the joint's own
      variation, and of the largest one.
    - `min_gravity`: smallest fraction of the arm's own gravity in the effort; without a tool of
      5 kg it is 0.58 on an iiwa.
    - `max_residual`: residual after the fit of a body, in units of the noise of earlier epochs.
      Real payloads reached 1.6 after 100 samples, faulty joints 3 and more.
    - `max_fault_lead`: log evidence by which a fault, with or without a body, may explain the
      change better, a ratio of 20. After 7 s a dead wrist of an arm without known axes has 3.1
      and more, a real payload 4.0 at most, and less with each second. A fault is a gain or a
      factor that differs from 1 by at least `min_gain_change`.
    - `max_echo`: largest ratio of the model's residual to that of the published torque.
    - `min_body`: log evidence of a body over none for a suspicion, odds of 5e8 to 1.
    - `min_over_push`, `min_over_varying`: log evidence of a body over a push, and over a varying
      force. Payloads of 0.5 to 5 kg had 11 to 54 over a push in six seconds of motion, of 1 to
      5 kg 10 to 200 over a varying force in sixteen.
    - `min_part`, `min_end`: share of the squared residual of each third of the window, and of
      its first and last second, that the rest predicts.
    - `max_no_chain_noise`, `max_no_chain_change`: residual of a change where no chain explains
      the arm, in units of the noise, and as a fraction of the change.
    - `min_gravity_ratio`: gravity of the arm in units of the noise from which its presence is
      judged.
    - `limit_std`: standard deviations by which a mass or a reach may exceed its limit.

    :raises OptionError: if a limit is not positive.
    """

    max_rise: float = 1.2
    max_worse: float = 2.0
    min_noise: float = 2e-3
    min_error: float = 1e-3
    min_explained: float = 0.2
    min_span: float = 0.5
    max_own: float = 0.35
    max_largest: float = 0.1
    min_gravity: float = 0.25
    max_residual: float = 2.5
    max_fault_lead: float = 3.0
    min_gain_change: float = 0.1
    max_echo: float = 0.9
    min_body: float = 20.0
    min_over_push: float = 10.0
    min_over_varying: float = 3.0
    min_part: float = 0.6
    min_end: float = 0.3
    max_no_chain_noise: float = 4.0
    max_no_chain_change: float = 0.15
    min_gravity_ratio: float = 5.0
    limit_std: float = 3.0

    def __post_init__(self) -> None:
        check_positive(self, 'acceptance')


OPTIONS = AcceptanceOptions()
# Largest time between consecutive samples whose differences count as noise, and the first and
# last part of a window in which a body must be present, s.
_MAX_INTERVAL, _END = 0.6, 1.0


def reference_noise(expected: FloatArray, samples: JointSamples,
                    residual: FloatArray) -> FloatArray:
    """
    Return the noise (N,) in N·m to compare a residual with.

    It is the larger of the noise of earlier epochs and the noise of `samples`, estimated from
    second differences of the residual (M, N). Gravity hardly contributes to these, so a sensor
    with more noise than in the training does not prevent a payload from being accepted.

    :param expected: noise of earlier epochs (N,), N·m.
    """
    floor = OPTIONS.min_noise * float(np.abs(samples.tau).max(initial=0.0)) + 1e-9
    noise = np.maximum(expected, floor)
    near = (np.diff(samples.t) < _MAX_INTERVAL) & (np.diff(samples.runs) == 0)
    triples = near[1:] & near[:-1]
    if triples.sum() < 5:
        return noise
    return np.maximum(noise, of_second_differences(residual, triples))


def joints_agree(samples: JointSamples, residual: FloatArray,
                 change: tuple[FloatArray, FloatArray] | None = None) -> Check:
    """
    Return the check of a model against its own samples, where there is no chain to compare with.

    The torques of an arm share one potential energy. Where the effort of one joint is faulty, no
    energy explains it together with the other joints.

    :param residual: RMS residual of the model (N,), N·m.
    :param change: noise of earlier epochs, and RMS of new minus old torque, (N,) in N·m; None
        for a first model, whose residual is compared with the variation of the effort.
    """
    if change is None:
        spread = samples.tau.std(axis=0)
        allowed = np.maximum(OPTIONS.max_own * spread,
                             OPTIONS.max_largest * float(spread.max(initial=0.0)))
    else:
        allowed = np.maximum(OPTIONS.max_no_chain_noise * change[0],
                             OPTIONS.max_no_chain_change * change[1])
    ratio = residual / np.maximum(allowed, 1e-9)
    worst = int(np.argmax(ratio))
    name, size = samples.names[worst], f'residual {residual[worst]:.3g} N·m'
    text = (f'the effort of {name} contradicts that of the other joints: {size} of '
            f'{spread[worst]:.3g} N·m' if change is None else
            f'the new model does not explain the effort of {name}: {size}, noise of earlier '
            f'epochs {change[0][worst]:.3g} N·m')
    return Check(checks.JOINTS_AGREE, float(ratio[worst]), 1.0, text=text)


def gravity_present(samples: JointSamples, before: FloatArray, noise: FloatArray) -> Check:
    """
    Return the check that the effort contains the gravity of the arm itself, with its sign.

    :param samples: without friction and offset.
    :param before: torque of the model before the change (M, N), N·m.
    """
    weighted = before / noise
    power = float((weighted ** 2).sum())
    share = 1.0
    if power > OPTIONS.min_gravity_ratio ** 2 * before.size:
        share = float((weighted * samples.tau / noise).sum()) / power
    return Check(checks.GRAVITY_PRESENT, share, OPTIONS.min_gravity, True, (
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
    margin = OPTIONS.max_fault_lead
    faults = [(fit.log_evidence, text, has_body) for one in tables
              for fit, text, has_body in one.faults()
              if abs(fit.mean[0]) >= OPTIONS.min_gain_change and fit.log_evidence > unchanged
              and one.ratio(fit).max() <= OPTIONS.max_residual]
    # A fault alone is named unless one with a body is clearly better.
    _, named, _ = max(faults, key=lambda fault: fault[0] - margin * fault[2],
                      default=(0.0, '', False))
    yield Check(checks.NO_FAULT, max((evidence for evidence, _, _ in faults), default=-np.inf)
                - explained, margin, text=named)
    ratio, noise = table.ratio(table.carried), window.reference
    worst = int(np.argmax(ratio))
    text = ''
    if ratio[worst] > OPTIONS.max_residual:
        joint, expected = table.most_faulty()
        text = (f'no payload explains the effort of {names[worst]}: residual '
                f'{ratio[worst] * noise[worst]:.3g} N·m, noise of earlier epochs '
                f'{noise[worst]:.3g}; most likely {names[joint]} '
                f'{_fault_of(samples.tau[:, joint], expected)}')
    yield Check(checks.BODY_EXPLAINS, float(ratio[worst]), OPTIONS.max_residual, text=text)
    yield from _within_limits(table)


def _fault_of(measured: FloatArray, expected: FloatArray) -> str:
    """Return the probable fault of a joint from its measured and expected torque (M,), N·m."""
    power = float((expected ** 2).sum())
    slope = float((measured * expected).sum()) / power if power > 0.0 else 1.0
    if slope < -0.5:
        return 'has the wrong sign'
    if measured.std() < 0.25 * expected.std():
        return 'is dead or frozen'
    return 'measures the torque of another joint, or has a wrong gain'


def _within_limits(table: Hypotheses) -> Iterator[Check]:
    limits, known, std = table.window.settings, table.body(), OPTIONS.limit_std
    if known is None:
        change = np.hypot(*table.moments.T)
        worst = int(np.argmax(change))
        largest = limits.max_payload_moment
        yield Check(checks.WITHIN_LIMITS, float(change[worst]), largest, text=(
            f'the change at {table.window.samples.names[worst]} is {change[worst]:.3g} N·m; the '
            f'limit is {largest:.3g} N·m, by max_payload {limits.max_payload:g} kg at '
            f'max_payload_reach {limits.max_payload_reach:g} m'))
        return
    mass, sigma, reach = known
    yield Check(checks.WITHIN_LIMITS, abs(mass), limits.max_payload + std * sigma, text=(
        f'the change is a body of {mass:.3g} kg; max_payload is {limits.max_payload:g} kg'))
    if abs(mass) > 10.0 * sigma:
        yield Check(checks.WITHIN_LIMITS, reach,
                    limits.max_payload_reach * (1.0 + std * sigma / abs(mass)), text=(
                        f'the change is a body of {mass:.3g} kg at {reach:.3g} m from the last '
                        f'joint; max_payload_reach is {limits.max_payload_reach:g} m'))


def suspicion_checks(table: Hypotheses) -> tuple[list[Check], list[Check]]:
    """
    Return the checks of a window for a payload that was not announced.

    :return: those that a body is present, then those that it is no other force.
    """
    t, body = table.window.samples.t, table.carried.log_evidence
    parts = table.explained(np.arange(len(t)) * PARTS // len(t) == np.arange(PARTS)[:, None])
    ends = table.explained([t <= t[0] + _END, t >= t[-1] - _END])
    present = [
        Check(checks.BODY_PRESENT, body - table.explain().log_evidence, OPTIONS.min_body, True),
        Check(checks.IN_EACH_PART, parts, OPTIONS.min_part, True),
        Check(checks.IN_EACH_PART, ends, OPTIONS.min_end, True)]
    other = [
        Check(checks.NO_PUSH, body - table.push().log_evidence, OPTIONS.min_over_push, True,
              'something pushes or pulls the last link, not only downwards'),
        Check(checks.NOT_VARYING, body - table.varying().log_evidence, OPTIONS.min_over_varying,
              True, 'a varying force acts on the last link')]
    return present, other
