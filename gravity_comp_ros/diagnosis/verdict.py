"""How sure one chosen effect is, and why it is not surer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.criteria import USUAL
from gravity_comp_ros.diagnosis.estimates import all_may_be_nothing, each_may_be_nothing
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

# What pulls a joint towards some angle.
_RESTS = ('joint_spring', 'cable_stiffness')


@dataclass(frozen=True)
class Part:
    """The torque of an effect as a share of that of another one, which is named."""

    share: float
    of: str


@dataclass(frozen=True, eq=False)
class Proof:
    """
    The evidence for one chosen effect beside the others.

    `kept` is its gain beside the rest, `proven` says that chance does not explain that, and
    `runs_better` is the share of runs in which it helps;
    `before` and `after` the RMSE of the joint where it helps most, of `n_effective` samples that
    count as independent; `free` coefficients are kept near no value by a prior; `unphysical` says
    why the coefficients are not those of an arm, None if they may be; `left` is the share of its
    torque that gravity does not imitate, `remainder` the effect whose law may leave it;
    `alternatives` explain as much; `twins` look the same in this motion; `elsewhere` are the
    errors (B, J) without and with it where poses like those judged were left out of the fit, None
    if all poses are alike.
    """

    kept: Gain
    proven: bool
    runs_better: float
    before: float
    after: float
    n_effective: float
    alternatives: tuple[str, ...]
    twins: tuple[str, ...]
    sizes: Mapping[str, Estimate]
    free: int
    unphysical: str | None
    left: float
    remainder: Part | None
    elsewhere: tuple[FloatArray, FloatArray] | None


def verdict(fits: Fits, chosen: Sequence[Candidate], candidate: Candidate, proof: Proof,
            options: VerdictOptions) -> tuple[Verdict, str]:
    """Return how sure an effect is, and in words why it is not surer ('' if it is)."""
    if proof.twins:
        names = ', '.join(proof.twins)
        return Verdict.UNTESTABLE, f'this motion cannot distinguish it from {names}'
    if proof.after >= (1.0 - options.least_reduction) * proof.before:
        return Verdict.WEAK, 'the held-out error of the joint hardly falls'
    if proof.n_effective < options.fewest_effective:
        return Verdict.WEAK, (
            f'the effective sample size is {proof.n_effective:.0f} here, and at least '
            f'{options.fewest_effective:.0f} is needed')
    if not proof.proven:
        return Verdict.WEAK, 'chance may explain what it takes off the error'
    if proof.unphysical is not None:
        return Verdict.WEAK, f'its size is not that of an arm: {proof.unphysical}'
    if proof.left < options.least_left:
        return Verdict.WEAK, (f'gravity can imitate all but {proof.left:.1%} of its torque in '
                              f'this motion, so that its size is uncertain')
    if proof.remainder is not None:
        return Verdict.WEAK, (f'it has {proof.remainder.share:.1%} of the torque of '
                              f'{proof.remainder.of}, and may be what the law of that leaves')
    if proof.elsewhere is not None and not within_standard_error(*proof.elsewhere):
        return Verdict.WEAK, 'it makes the error larger at poses that the fit has not seen'
    if each_may_be_nothing(proof.sizes):
        together = len(proof.sizes) > 1 and not all_may_be_nothing(fits, chosen, candidate)
        return Verdict.WEAK, ('this motion cannot distinguish its coefficients' if together
                              else 'the interval of every coefficient covers 0')
    if proof.alternatives:
        return Verdict.AMBIGUOUS, f'{", ".join(proof.alternatives)} would explain as much'
    many = options.many_rare if candidate.effect.expectation == Expectation.RARE else options.many
    if (proof.free > many and proof.n_effective < _asked(proof, options)
            and proof.after ** 2 > (1.0 - options.evident_of_many) * proof.before ** 2):
        return Verdict.WEAK, _too_few(proof, options)
    doubt = _doubt(fits, chosen, candidate, proof, options)
    return (Verdict.LIKELY, doubt) if doubt else (Verdict.ESTABLISHED, '')


def _doubt(fits: Fits, chosen: Sequence[Candidate], candidate: Candidate, proof: Proof,
           options: VerdictOptions) -> str:
    """Return why an effect is likely at most, '' if nothing speaks against more."""
    if proof.n_effective < _asked(proof, options):
        return _too_few(proof, options)
    fit = fits.fit(candidate.place, chosen)
    here = np.isin(fit.columns, candidate.columns)
    if not (np.sign(fit.without[:, here][:, 0]) == np.sign(fit.all_data[here][0])).all():
        return 'its sign changes with the part of the recording that is left out'
    if proof.runs_better < options.most_runs:
        return f'it helps in {proof.runs_better:.0%} of the runs only'
    first = next(iter(proof.sizes.values()))
    if first.ci95[0] <= 0.0 <= first.ci95[1]:
        return 'the interval of its first coefficient covers 0'
    if proof.elsewhere is not None and not (
            float(proof.elsewhere[1].sum()) < float(proof.elsewhere[0].sum())):
        return 'it does not help at poses that the fit has not seen'
    return ''


def _asked(proof: Proof, options: VerdictOptions) -> float:
    """Return the effective sample size that an established effect needs."""
    return options.least_effective + options.effective_each * (proof.free - 1)


def _too_few(proof: Proof, options: VerdictOptions) -> str:
    coefficients = counted(proof.free, 'coefficient')
    return (f'the effective sample size is {proof.n_effective:.0f} here; '
            f'{_asked(proof, options):.0f} is needed for {coefficients}')


def remainder_of(fits: Fits, candidate: Candidate, chosen: Sequence[Candidate],
                 options: VerdictOptions) -> Part | None:
    """
    Return the effect on the same joint whose law may leave what something rare explains.

    None if the candidate has a fair part of the torque of each of them, or goes on with time, as
    laws of angle and speed do not.
    """
    effect, joint = candidate.effect, candidate.acts_on
    if joint is None or effect.expectation == Expectation.MOTION or effect.corrects \
            or effect.signature == 'time' or effect.name in USUAL:
        return None
    size = float(fits.torque(joint, chosen, [candidate]).std())
    for other in chosen:
        if other is candidate or other.acts_on != joint:
            continue
        name = other.effect.name
        share = size / max(float(fits.torque(joint, chosen, [other]).std()), 1e-12)
        confused = name in effect.confounders and name not in USUAL
        if share < (options.least_of_confounder if confused else options.least_part):
            return Part(share, name)
    return None


def rest_angles(fits: Fits, motion: Motion, candidate: Candidate,
                chosen: Sequence[Candidate]) -> tuple[str, ...]:
    """
    Return the springs that an offset on their joint may be a part of.

    A spring is described about the mean angle of the motion, a cable from where it becomes taut.
    Where it rests is an offset beside it. A spring that pulls in one posture alone looks like
    gravity, but for that offset.
    """
    if candidate.effect.name != 'torque_offset':
        return ()
    spring = 'joint_spring', candidate.joint
    if spring in fits.layout.untestable and insufficient_postures(motion, candidate.place):
        return spring[:1]
    return tuple(c.effect.name for c in chosen
                 if c.joint == candidate.joint and c.effect.name in _RESTS)


def untestable_twins(fits: Fits, motion: Motion, candidate: Candidate,
                     options: VerdictOptions) -> tuple[str, ...]:
    """Return confounders that this motion cannot tell from the effect."""
    if candidate.shared or candidate.joint is None:
        return ()
    known, twins = all_effects(), []
    mine = candidate.effect.columns(motion, candidate.joint, candidate.setting)
    for name in candidate.effect.confounders:
        other = known.get(name)
        if other is None or other.scope != 'joint':
            continue
        # A rarer effect that looks the same does not make a common one doubtful.
        if other.expectation == Expectation.RARE != candidate.effect.expectation:
            continue
        if (name, candidate.joint) not in fits.layout.untestable:
            continue
        settings = other.settings(motion, candidate.joint) or [{}]
        try:
            columns = other.columns(motion, candidate.joint, settings[0])
        except (KeyError, ValueError):
            continue
        if _alike(mine, columns) > options.alike:
            twins.append(name)
    return tuple(twins)


def _alike(a: FloatArray, b: FloatArray) -> float:
    """Return which share of columns b (M, K) the columns a imitate, means left in."""
    basis, _ = np.linalg.qr(a)
    total = float((b ** 2).sum())
    return float(((basis.T @ b) ** 2).sum() / total) if total > 0.0 else 0.0
