"""Verdict on one chosen effect: its confidence, and the reason why it is not higher."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.criteria import STANDARD_TERMS
from gravity_comp_ros.diagnosis.estimates import every_interval_covers_zero, jointly_insignificant
from gravity_comp_ros.diagnosis.findings import Estimate, Verdict
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.diagnosis.options import VerdictOptions
from gravity_comp_ros.effects.effect import Expectation
from gravity_comp_ros.effects.excitation import insufficient_postures
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.evaluation.gain import Gain, within_standard_error
from gravity_comp_ros.printable import counted
import numpy as np

# Effects that pull a joint towards a rest angle.
_ELASTIC = ('joint_spring', 'cable_stiffness')
_COLLINEAR = 'this motion cannot distinguish its coefficients'


@dataclass(frozen=True)
class TorqueRatio:
    """Ratio of an effect's torque to that of the effect `of`."""

    share: float
    of: str


@dataclass(frozen=True, eq=False)
class EffectEvidence:
    """
    Evidence for one chosen effect, given the others.

    - `gain`: held-out gain in addition to the others; `significant`: whether p is below alpha.
    - `runs_better`: share of runs that it improves.
    - `before`, `after`: RMSE of the most affected joint without and with it.
    - `n_effective`: effective sample size on that joint.
    - `alternatives`: effects that explain as much.
    - `indistinguishable`: effects that are collinear with it in this motion.
    - `sizes`: its coefficients; `n_free`: number of coefficients without a prior.
    - `unphysical`: why the coefficients are not physical, or None.
    - `unabsorbed`: share of its torque that gravity does not absorb.
    - `model_error`: another effect whose model error it may be, or None.
    - `errors_at_new_poses`: errors (B, J) without and with it, with folds by pose; None if all
      blocks have the same poses.
    """

    gain: Gain
    significant: bool
    runs_better: float
    before: float
    after: float
    n_effective: float
    alternatives: tuple[str, ...]
    indistinguishable: tuple[str, ...]
    sizes: Mapping[str, Estimate]
    n_free: int
    unphysical: str | None
    unabsorbed: float
    model_error: TorqueRatio | None
    errors_at_new_poses: tuple[FloatArray, FloatArray] | None


def verdict(fits: Fits, chosen: Sequence[Candidate], candidate: Candidate,
            evidence: EffectEvidence, options: VerdictOptions) -> tuple[Verdict, str]:
    """Return the verdict on an effect, and why it is not better ('' for the best)."""
    if evidence.indistinguishable:
        names = ', '.join(evidence.indistinguishable)
        return Verdict.UNTESTABLE, f'this motion cannot distinguish it from {names}'
    reason = _reason_for_weak(fits, chosen, candidate, evidence, options)
    if reason:
        return Verdict.WEAK, reason
    if evidence.alternatives:
        names = ', '.join(evidence.alternatives)
        return Verdict.AMBIGUOUS, f'{names} would explain as much'
    rare = candidate.effect.expectation == Expectation.RARE
    limit = options.max_rare_coefficients if rare else options.max_coefficients
    too_few = evidence.n_effective < _required_size(evidence, options)
    if evidence.n_free > limit and too_few and not _is_evident(evidence, options):
        return Verdict.WEAK, _too_few_samples(evidence, options)
    reason = (_too_few_samples(evidence, options) if too_few else
              _reason_for_likely(fits, chosen, candidate, evidence, options))
    return (Verdict.LIKELY, reason) if reason else (Verdict.ESTABLISHED, '')


def _reason_for_weak(fits: Fits, chosen: Sequence[Candidate], candidate: Candidate,
                     evidence: EffectEvidence, options: VerdictOptions) -> str:
    """Return why an effect is weak whatever its alternatives, '' if it is not."""
    if evidence.after >= (1.0 - options.min_reduction) * evidence.before:
        return 'it hardly reduces the held-out error of the joint'
    if evidence.n_effective < options.min_effective:
        return (f'the effective sample size is {evidence.n_effective:.0f}; at least '
                f'{options.min_effective:.0f} is required')
    if not evidence.significant:
        return 'its reduction of the error is not statistically significant'
    if evidence.unphysical is not None:
        return f'its size is not physical: {evidence.unphysical}'
    if evidence.unabsorbed < options.min_unabsorbed:
        return (f'gravity absorbs all but {evidence.unabsorbed:.1%} of its torque in this motion, '
                f'so that its size is uncertain')
    if evidence.model_error is not None:
        return (f'it has {evidence.model_error.share:.1%} of the torque of '
                f'{evidence.model_error.of} and may be a model error of that effect')
    at_new_poses = evidence.errors_at_new_poses
    if at_new_poses is not None and not within_standard_error(*at_new_poses):
        return 'it increases the error at poses outside the training set'
    if every_interval_covers_zero(evidence.sizes):
        if len(evidence.sizes) == 1 or jointly_insignificant(fits, chosen, candidate):
            return 'the interval of every coefficient covers 0'
        if not _is_evident(evidence, options):
            return _COLLINEAR
    return ''


def _is_evident(evidence: EffectEvidence, options: VerdictOptions) -> bool:
    """Return whether an effect removes nearly all of the joint's squared error."""
    return evidence.after ** 2 <= (1.0 - options.evident_reduction) * evidence.before ** 2


def _reason_for_likely(fits: Fits, chosen: Sequence[Candidate], candidate: Candidate,
                       evidence: EffectEvidence, options: VerdictOptions) -> str:
    """Return why an effect with enough samples is not established, '' if it is."""
    fit = fits.fit(candidate.joint_index, chosen)
    here = np.isin(fit.columns, candidate.columns)
    if not (np.sign(fit.by_fold[:, here][:, 0]) == np.sign(fit.all_data[here][0])).all():
        return 'its sign differs between cross-validation folds'
    if evidence.runs_better < options.min_runs_better:
        return f'it reduces the error in only {evidence.runs_better:.0%} of the runs'
    if every_interval_covers_zero(evidence.sizes):
        return _COLLINEAR
    first = next(iter(evidence.sizes.values()))
    if first.ci95[0] <= 0.0 <= first.ci95[1]:
        return 'the interval of its first coefficient covers 0'
    if evidence.errors_at_new_poses is not None:
        without, with_it = evidence.errors_at_new_poses
        if not float(with_it.sum()) < float(without.sum()):
            return 'it does not reduce the error at poses outside the training set'
    return ''


def _required_size(evidence: EffectEvidence, options: VerdictOptions) -> float:
    """Return the effective sample size that an established effect requires."""
    return (options.min_effective_established
            + options.effective_per_coefficient * (evidence.n_free - 1))


def _too_few_samples(evidence: EffectEvidence, options: VerdictOptions) -> str:
    return (f'the effective sample size is {evidence.n_effective:.0f}; '
            f'{_required_size(evidence, options):.0f} is required for '
            f'{counted(evidence.n_free, "coefficient")}')


def possible_model_error(fits: Fits, candidate: Candidate, chosen: Sequence[Candidate],
                         options: VerdictOptions) -> TorqueRatio | None:
    """
    Return an effect on the same joint whose model error a rare effect may be.

    An effect that acts on several joints is compared with its confounders of that kind, by the
    torque of all joints. None if the candidate's torque is large compared with that of each other
    effect, or is a function of time, which model errors of angle and speed are not.
    """
    effect, joint = candidate.effect, candidate.acts_on
    if effect.expectation == Expectation.MOTION or effect.corrects \
            or effect.signature == 'time' or effect.name in STANDARD_TERMS:
        return None
    size = _torque_size(fits, candidate, chosen)
    for other in chosen:
        if other is candidate or other.acts_on != joint:
            continue
        name = other.effect.name
        confounder = name in effect.confounders and name not in STANDARD_TERMS
        if joint is None and not confounder:
            continue
        share = size / max(_torque_size(fits, other, chosen), 1e-12)
        if share < (options.min_confounder_ratio if confounder else options.min_torque_ratio):
            return TorqueRatio(share, name)
    return None


def _torque_size(fits: Fits, candidate: Candidate, chosen: Sequence[Candidate]) -> float:
    """Return the standard deviation of an effect's torque in N·m, over all its joints."""
    joints = range(fits.n_joints) if candidate.acts_on is None else [candidate.acts_on]
    return float(np.sqrt(sum(float(fits.torque(joint, chosen, [candidate]).var())
                             for joint in joints)))


def springs_of_offset(fits: Fits, motion: Motion, candidate: Candidate,
                      chosen: Sequence[Candidate]) -> tuple[str, ...]:
    """
    Return elastic effects that are alternative explanations of an offset on their joint.

    The column of a spring is centred at the mean angle of the motion, that of a cable starts
    where it becomes taut; an offset in addition moves the rest angle. In a single posture gravity
    absorbs a spring except for this offset.
    """
    if candidate.effect.name != 'torque_offset':
        return ()
    if (('joint_spring', candidate.joint) in fits.layout.untestable
            and insufficient_postures(motion, candidate.joint_index)):
        return ('joint_spring',)
    return tuple(c.effect.name for c in chosen
                 if c.joint == candidate.joint and c.effect.name in _ELASTIC)


def indistinguishable_confounders(fits: Fits, motion: Motion, candidate: Candidate,
                                  options: VerdictOptions) -> tuple[str, ...]:
    """Return untestable confounders that are collinear with the effect in this motion."""
    if candidate.shared or candidate.joint is None:
        return ()
    known, names = all_effects(), []
    own = candidate.effect.columns(motion, candidate.joint, candidate.setting)
    for name in candidate.effect.confounders:
        other = known.get(name)
        if other is None or other.scope != 'joint':
            continue
        # A rare confounder does not make a common effect uncertain.
        if other.expectation == Expectation.RARE != candidate.effect.expectation:
            continue
        if (name, candidate.joint) not in fits.layout.untestable:
            continue
        settings = other.settings(motion, candidate.joint) or [{}]
        try:
            columns = other.columns(motion, candidate.joint, settings[0])
        except (KeyError, ValueError):
            continue
        if _explained_share(own, columns) > options.max_collinearity:
            names.append(name)
    return tuple(names)


def _explained_share(a: FloatArray, b: FloatArray) -> float:
    """Return the share of the squares of columns b (M, K) that columns a explain."""
    basis, _ = np.linalg.qr(a)
    total = float((b ** 2).sum())
    return float(((basis.T @ b) ** 2).sum() / total) if total > 0.0 else 0.0
