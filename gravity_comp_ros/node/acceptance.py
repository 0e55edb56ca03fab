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
from gravity_comp_ros.node.hypotheses import Explanation, gain_of, Hypotheses, PARTS
from gravity_comp_ros.node.parameters import Parameters
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
      effort has no gravity, judged from `min_samples` samples and a range of `min_span` rad.
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

    :raises OptionError: if a limit is not positive.
    """

    max_rise: float = 1.2
    max_worse: float = 2.0
    min_noise: float = 2e-3
    min_error: float = 1e-3
    min_explained: float = 0.2
    min_samples: int = 100
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

    def __post_init__(self) -> None:
        check_positive(self, 'acceptance')


OPTIONS = AcceptanceOptions()
# Largest time between consecutive samples whose differences count as noise, s.
_MAX_INTERVAL = 0.6
# Ratio of the gravity of the arm to the noise from which its presence is judged.
_MIN_GRAVITY_RATIO = 5.0
# Largest residual where no chain explains the arm: in units of noise, and of the change.
_NO_CHAIN_NOISE, _NO_CHAIN_CHANGE = 4.0, 0.15
# Standard deviations by which a mass or a reach may exceed its limit.
_SIGNIFICANT = 3.0
# First and last part of a window in which a body must be present, s.
_END = 1.0


def reference_noise(expected: FloatArray, samples: JointSamples,
                    predicted: FloatArray) -> FloatArray:
    """
    Return the noise (N,) in N·m to compare a residual with.

    It is the larger of the noise of earlier epochs and the noise of `samples`, estimated from
    second differences of their residual. Gravity hardly contributes to these, so a sensor with
    more noise than in the training does not prevent a payload from being accepted.

    :param expected: noise of earlier epochs (N,), N·m.
    """
    floor = OPTIONS.min_noise * float(np.abs(samples.tau).max(initial=0.0)) + 1e-9
    noise = np.maximum(expected, floor)
    near = (np.diff(samples.t) < _MAX_INTERVAL) & (np.diff(samples.runs) == 0)
    triples = near[1:] & near[:-1]
    if triples.sum() < 5:
        return noise
    return np.maximum(noise, of_second_differences(samples.tau - predicted, triples))


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
        allowed = np.maximum(_NO_CHAIN_NOISE * change[0], _NO_CHAIN_CHANGE * change[1])
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
    if power > _MIN_GRAVITY_RATIO ** 2 * before.size:
        share = float((weighted * samples.tau / noise).sum()) / power
    return Check(checks.GRAVITY_PRESENT, share, OPTIONS.min_gravity, True, (
        f'the effort contains {share:.0%} of the gravity of the arm itself: drives off, gravity '
        'subtracted by the driver, or another unit or sign'))


def body_checks(tables: Sequence[Hypotheses], noise: FloatArray, scale: FloatArray | float,
                limits: Parameters, forces: Sequence[Explanation] = ()) -> Iterator[Check]:
    """
    Yield the checks of a change: a body on the last link explains it, and no fault does so better.

    :param tables: for each estimate of the axes, that of the most probable body first.
    :param noise: reference noise (N,) in N·m, `scale` its ratio to that of the tables (N,).
    :param forces: other hypotheses that a fault must explain the change better than.
    """
    table = tables[0]
    samples, names = table.samples, table.samples.names
    yield gravity_present(samples, table.before, noise)
    body = table.carried
    unchanged = max(each.explain().log_evidence for each in tables)
    explained = max(unchanged, *(each.log_evidence for each in (body, *forces)))
    margin = OPTIONS.max_fault_lead
    faults = [(fit.log_evidence, text, has_body) for one in tables
              for fit, text, has_body in _faults(one) if fit.log_evidence > unchanged
              and (fit.ratio(samples.qd) / scale).max() <= OPTIONS.max_residual]
    # A fault alone is named unless one with a body is clearly better.
    _, named, _ = max(faults, key=lambda fault: fault[0] - margin * fault[2],
                      default=(0.0, '', False))
    yield Check(checks.NO_FAULT, max((evidence for evidence, _, _ in faults), default=-np.inf)
                - explained, margin, text=named)
    ratio = body.ratio(samples.qd) / scale
    worst = int(np.argmax(ratio))
    text = ''
    if ratio[worst] > OPTIONS.max_residual:
        fits = [table.without_joint(joint) for joint in range(len(names))]
        joint = int(np.argmin([cost for cost, _ in fits]))
        text = (f'no payload explains the effort of {names[worst]}: residual '
                f'{ratio[worst] * noise[worst]:.3g} N·m, noise of earlier epochs '
                f'{noise[worst]:.3g}; most likely {names[joint]} '
                f'{gain_of(samples.tau[:, joint], fits[joint][1])}')
    yield Check(checks.BODY_EXPLAINS, float(ratio[worst]), OPTIONS.max_residual, text=text)
    yield from _within_limits(table, limits)


def _faults(table: Hypotheses) -> Iterator[tuple[Explanation, str, bool]]:
    """
    Yield the gains of a joint, with and without a body, and a common factor, that differ from 1.

    :return: the fit, a sentence, and whether it includes a body.
    """
    names = table.samples.names
    fits = [(table.factor(), 'all joints', ': another unit or gain, no payload', False)]
    for k in table.loaded_joints():
        fits += [(table.gain(k), names[k], ', and that of no other joint has changed: its sensor '
                  'or its drive is faulty', False),
                 (table.body_and_gain(k), names[k], ', also with a body that explains the rest: '
                  'its sensor or its drive is faulty', True)]
    for fit, name, why, has_body in fits:
        change = float(fit.mean[0])
        if abs(change) >= OPTIONS.min_gain_change:
            yield fit, (f'the effort of {name} is {1.0 + change:.3g} times the earlier one'
                        f'{why}'), has_body


def _within_limits(table: Hypotheses, limits: Parameters) -> Iterator[Check]:
    known = table.carried_body()
    if known is None:
        change = table.carried_moments()
        worst = int(np.argmax(change))
        largest = limits.max_payload_moment
        yield Check(checks.WITHIN_LIMITS, float(change[worst]), largest, text=(
            f'the change at {table.samples.names[worst]} is {change[worst]:.3g} N·m; the limit is '
            f'{largest:.3g} N·m, by max_payload {limits.max_payload:g} kg at max_payload_reach '
            f'{limits.max_payload_reach:g} m'))
        return
    mass, sigma, reach = known
    yield Check(checks.WITHIN_LIMITS, abs(mass), limits.max_payload + _SIGNIFICANT * sigma, text=(
        f'the change is a body of {mass:.3g} kg; max_payload is {limits.max_payload:g} kg'))
    if abs(mass) > 10.0 * sigma:
        yield Check(checks.WITHIN_LIMITS, reach,
                    limits.max_payload_reach * (1.0 + _SIGNIFICANT * sigma / abs(mass)), text=(
                        f'the change is a body of {mass:.3g} kg at {reach:.3g} m from the last '
                        f'joint; max_payload_reach is {limits.max_payload_reach:g} m'))


def suspicion_checks(table: Hypotheses) -> tuple[list[Check], list[Check]]:
    """
    Return the checks of a window for a payload that was not announced.

    :return: those that a body is present, then those that it is no other force.
    """
    samples = table.samples
    m = len(samples)
    body, none = table.carried, table.explain()
    parts = table.explained(np.arange(m) * PARTS // m == np.arange(PARTS)[:, None])
    ends = table.explained([samples.t <= samples.t[0] + _END, samples.t >= samples.t[-1] - _END])
    present = [
        Check(checks.BODY_PRESENT, body.log_evidence - none.log_evidence, OPTIONS.min_body, True),
        Check(checks.IN_EACH_PART, float(parts.min()), OPTIONS.min_part, True),
        Check(checks.IN_EACH_PART, float(ends.min()), OPTIONS.min_end, True)]
    other = [
        Check(checks.NO_PUSH, body.log_evidence - table.push().log_evidence,
              OPTIONS.min_over_push, True,
              'something pushes or pulls the last link, not only downwards'),
        Check(checks.NOT_VARYING, body.log_evidence - table.varying().log_evidence,
              OPTIONS.min_over_varying, True, 'a varying force acts on the last link')]
    return present, other
