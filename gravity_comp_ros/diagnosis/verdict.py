"""Thresholds of a diagnosis, verdicts on the terms of an estimate, and unexplained torque."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.diagnosis.findings import Finding, FOUND, Verdict
from gravity_comp_ros.effects.effect import Setting
from gravity_comp_ros.effects.registry import all_effects, known_effect
from gravity_comp_ros.effects.rigid_body import DYNAMICS
from gravity_comp_ros.estimation.estimate import Estimate
from gravity_comp_ros.estimation.estimated_model import (
    alternatives_of, gain_of_dynamics, has_dynamics, is_absorbed, motion_parameters, target_of,
    values_of)
from gravity_comp_ros.estimation.held_out import held_out_torques, HeldOutTorques
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.regression.gains import gain as gain_at, p_of, score_of
from gravity_comp_ros.regression.noise import correlation_times
from gravity_comp_ros.regression.term import Term
import numpy as np

# Number of bumps over the range of a joint, and prior standard deviation of each as a share of
# the torque scale.
_BUMPS, _SIZE = 24, 0.03


@dataclass(frozen=True)
class DiagnosisOptions:
    """
    Options of a diagnosis.

    - `effects`: the effects to test (None: all).
    - `established`: gain in nats of an established effect; odds of 20,000 to 1.
    - `min_reduction`: smallest relative decrease of the held-out RMSE of the most affected joint
      that is worth adding.
    - `min_remaining`: share of the torque range above which a joint's remaining error is reported,
      and share of the error of a joint by which the part that repeats with its angle must reduce
      it to be a finding.
    - `min_effective`: effective sample size that an established effect needs; intervals over
      fewer independent blocks are too narrow.

    :raises OptionError: if a threshold is not positive, or an effect is unknown.
    """

    effects: tuple[str, ...] | None = None
    established: float = 10.0
    min_reduction: float = 0.002
    min_remaining: float = 0.01
    min_effective: float = 20.0

    def __post_init__(self) -> None:
        check_positive(self, 'diagnosis', *(name for name in vars(self) if name != 'effects'))
        for name in self.effects or ():
            known_effect(name)


@dataclass(frozen=True, eq=False)
class Evidence:
    """
    An estimate with its held-out torques.

    `in_model` are the targets of the diagnosed model, `absorbed` those of terms that gravity
    absorbs nearly whole: they are predicted, but remain findings. `n_effective` (N,) is the
    effective sample size of each joint.
    """

    estimated: Estimate
    torques: HeldOutTorques
    in_model: frozenset[str]
    absorbed: frozenset[str]
    n_effective: FloatArray
    options: DiagnosisOptions

    @classmethod
    def of(cls, estimated: Estimate, model: GravityModel | None,
           options: DiagnosisOptions) -> Evidence:
        """Return the evidence for what a model does not predict; None for a model of gravity."""
        regression = estimated.regression
        absorbed = frozenset(target_of(term, regression.problem.samples.names)
                             for term in regression.terms if is_absorbed(estimated, term))
        return cls(estimated, held_out_torques(estimated),
                   frozenset(e.target for e in model.applied.effects) if model else frozenset(),
                   absorbed, regression.problem.rows.n_rows / correlation_times(
                       regression.posterior), options)

    @property
    def predicted(self) -> frozenset[str]:
        """Return the targets that the diagnosed model predicts, those of absorbed terms too."""
        return self.in_model | self.absorbed

    @property
    def joints(self) -> tuple[str, ...]:
        return self.estimated.regression.problem.samples.names

    @cached_property
    def span(self) -> FloatArray:
        """Return the range of the torque of each joint (N,), N·m."""
        return np.maximum(np.ptp(self.torques.tau, axis=0), 1e-12)

    def held_out(self, name: str, joint: str | None) -> tuple[float, float, float]:
        """
        Return the held-out error without and with an effect, and the share of runs it improves.

        All other terms are predicted. The errors are those of the joint that the effect changes
        most, as shares of its torque range.
        """
        torques = self.torques
        if joint is None:
            n = int(np.argmax((torques.effects[name] ** 2).mean(axis=0) / self.span ** 2))
        else:
            n = self.joints.index(joint)
        others = {*torques.effects, *self.predicted} - {name}
        squares = np.stack([torques.residual(targets)[:, n] ** 2
                            for targets in (others, others | {name})])
        before, after = np.sqrt(squares.mean(axis=1)) / self.span[n]
        better = [np.less(*squares[::-1, torques.run == k].sum(axis=1))
                  for k in np.unique(torques.run)]
        return float(before), float(after), float(np.mean(better))


def finding_of(evidence: Evidence, term: Term) -> Finding:
    """Return the finding of a term of the estimate."""
    regression = evidence.estimated.regression
    joint = None if term.joint is None else evidence.joints[term.joint]
    gain = regression.gains[term.key]
    shares = regression.identified[term.key]
    values, std = regression.posterior.beta[regression.posterior.at[term]], \
        regression.uncertainty.stds[term.key]
    before, after, better = evidence.held_out(target_of(term, evidence.joints), joint)
    others = alternatives_of(regression, term, evidence.joints)
    listed = term.effect.coefficients_of(regression.motion, term.joint_number, term.setting)
    share = regression.unabsorbed[term.key]
    identified = shares >= regression.problem.options.min_identified
    covers_zero = HALF_95 * regression.uncertainty.size_stds[term.key] > 1.0
    is_better = after < (1.0 - evidence.options.min_reduction) * before
    implausible = term.effect.implausible(values, term.setting)
    verdict, why = _verdict(evidence, term, implausible, covers_zero, is_better, others)
    sizes = {symbol: size for (symbol, size), given
             in zip(values_of(listed, values, std).items(), identified) if given}
    step = '' if verdict in FOUND else term.effect.experiment.format(joint=joint or 'the arm')
    return Finding(joint, term.name, verdict, others, sizes, before, after, 1.0 - share, better,
                   why, step, gain, p_of(gain - term.log_prior), dict(term.setting),
                   to_add=_to_add(evidence, term, verdict, implausible is None))


def _to_add(evidence: Evidence, term: Term, verdict: Verdict,
            is_physical: bool) -> tuple[str, ...]:
    """
    Return the targets to add for a finding: of an ambiguous one also its alternatives.

    Of a term with a size that is not physical they are its alternatives alone.
    """
    regression, joints = evidence.estimated.regression, evidence.joints
    # A term that gravity absorbs is predicted by every model of this estimate.
    if verdict not in (*FOUND, Verdict.AMBIGUOUS) or is_absorbed(evidence.estimated, term):
        return ()
    own = (target_of(term, joints),) if is_physical else ()
    if verdict in FOUND:
        return own
    return (*own, *(
        target(name, None if joint is None else joints[joint])
        for name, joint in regression.alternatives[term.key]
        if (name, joint) not in regression.candidates.untestable))


def _verdict(evidence: Evidence, term: Term, implausible: str | None, covers_zero: bool,
             is_better: bool, others: tuple[str, ...]) -> tuple[Verdict, str]:
    """Return the verdict on a term, and why it is not better ('' for the best)."""
    regression, options = evidence.estimated.regression, evidence.options
    gain, share = regression.gains[term.key], regression.unabsorbed[term.key]
    engine = regression.problem.options
    alternatives = f'{", ".join(others)} would explain as much' if others else ''
    if share < engine.min_identified:
        why = (f'gravity absorbs all but {share:.1%} of its torque in this motion: their sum is '
               f'predicted, and its size is not identified')
        return (Verdict.AMBIGUOUS, f'{alternatives}; {why}') if others else (
            Verdict.UNTESTABLE, why)
    why = f'its size is not physical: {implausible}' if implausible else ''
    if implausible and not others:
        return Verdict.WEAK, why
    if not is_better:
        return Verdict.WEAK, 'it hardly reduces the held-out error of the joint'
    if covers_zero:
        return Verdict.WEAK, 'the interval of its size covers 0'
    if gain < engine.min_gain:
        # The noise of the selection has no autocorrelation; that of the result has.
        return Verdict.WEAK, _little_evidence(gain, engine.min_gain)
    if others:
        return Verdict.AMBIGUOUS, f'{alternatives}; {why}' if why else alternatives
    joints = range(len(evidence.joints)) if term.joint is None else [term.joint]
    size = float(max(evidence.n_effective[n] for n in joints))
    if size < options.min_effective:
        return Verdict.LIKELY, (f'the effective sample size is {size:.0f}; '
                                f'{options.min_effective:.0f} is required')
    if gain < options.established:
        return Verdict.LIKELY, _little_evidence(gain, options.established)
    return Verdict.ESTABLISHED, ''


def finding_of_dynamics(evidence: Evidence) -> Finding | None:
    """
    Return the finding of rigid-body dynamics, None without evidence.

    Every estimate contains dynamics, so that the gain is computed here; the gain at which it is
    a finding is that of all terms.
    """
    regression = evidence.estimated.regression
    shared, posterior = regression.shared, regression.posterior
    if DYNAMICS in evidence.in_model or DYNAMICS not in evidence.torques.effects \
            or not has_dynamics(shared):
        return None
    gain = gain_of_dynamics(regression)
    if gain < regression.problem.options.min_gain:
        return None
    before, after, better = evidence.held_out(DYNAMICS, None)
    if after >= (1.0 - evidence.options.min_reduction) * before:
        return None
    p = len(shared.point)
    std = np.sqrt(np.maximum(np.diag(posterior.covariance)[:p], 0.0))
    effect = all_effects()[DYNAMICS]
    listed = effect.coefficients_of(regression.motion, 0, {})
    sizes = values_of(listed, motion_parameters(shared, posterior.beta[:p]),
                      motion_parameters(shared, std))
    established = gain >= evidence.options.established
    why = '' if established else _little_evidence(gain, evidence.options.established)
    return Finding(None, DYNAMICS, Verdict.ESTABLISHED if established else Verdict.LIKELY, (),
                   sizes, before, after, 0.0, better, why, '', gain, p_of(gain),
                   to_add=(DYNAMICS,))


def _little_evidence(gain: float, required: float) -> str:
    return f'its evidence is {gain:.1f} nats; {required:.0f} are required'


def unexplained(evidence: Evidence) -> list[Finding]:
    """
    Return a finding for each joint whose residual repeats with its angle.

    The residual of the estimate is compared with bumps over the angle, by the same criterion as
    the effects: a column of Gaussian bumps with a prior of a few percent of the torque.
    """
    regression = evidence.estimated.regression
    problem, findings = regression.problem, []
    rmse = evidence.torques.rmse({*evidence.predicted, *evidence.torques.effects})
    for n, name in enumerate(evidence.joints):
        q = problem.rows.mean(problem.samples.q[:, n])
        if np.ptp(q) <= FactOptions().min_travel:
            continue
        bumps, centres = _bumps(q)
        std = np.full(_BUMPS, _SIZE * float(problem.scale.torque[n]))
        # The effect of the term is not used by the score.
        term = Term(_NoEffect(), n, {}, bumps, std, -np.log(1e3))  # type: ignore[arg-type]
        scored = score_of(regression.posterior, term)
        value = gain_at(regression.posterior, scored)
        if value < problem.options.min_gain:
            continue
        torque = bumps @ scored.mean
        before = float(rmse[n])
        after = float(np.sqrt(max(before ** 2 - float((torque ** 2).mean()), 0.0)))
        if before - after < evidence.options.min_remaining * before:
            continue
        angle = float(centres[int(np.argmax(np.abs(scored.mean)))])
        findings.append(Finding(
            name, None, Verdict.UNEXPLAINED, (), {}, before / evidence.span[n],
            after / evidence.span[n],
            1.0 - scored.unabsorbed, 1.0,
            'the residual repeats with the angle, and no effect of the library describes it',
            f'inspect joint {name} near {angle:.2f} rad', value, p_of(value),
            {'angle': angle}))
    return findings


def _bumps(q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Gaussian bumps (R, K) over angles (R,) in rad, and their centres (K,)."""
    centres = np.linspace(q.min(), q.max(), _BUMPS)
    width = float(centres[1] - centres[0])
    return np.exp(-0.5 * ((q[:, None] - centres) / width) ** 2), centres


class _NoEffect:
    """The effect of a term that is no effect of the library."""

    name, corrects, is_static = 'unexplained', (), True

    def positive(self, setting: Setting, count: int) -> BoolArray:
        return np.zeros(count, dtype=bool)
