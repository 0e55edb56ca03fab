"""What repeats and no effect describes: torque by another law, or of no known shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.alternative_models import Alternative
from gravity_comp_ros.diagnosis.candidates import Candidate, Trial
from gravity_comp_ros.diagnosis.findings import Finding, Verdict
from gravity_comp_ros.diagnosis.nonparametric import largest_angle, UnknownTorque
from gravity_comp_ros.diagnosis.scale import Scale
from gravity_comp_ros.diagnosis.wording import evidence_sentence
from gravity_comp_ros.evaluation.gain import gain, gain_in_few_blocks
import numpy as np

# Unknown structure worth a finding takes this share off the remaining error.
_STRUCTURE_SHARE = 0.05
# Structure sits in the few blocks that pass its angle, which makes its mean uncertain.
_STRUCTURE_ALPHA = 0.05
_REMAINDER_SHARE = 0.3
# A known effect that does this part of what an unknown torque would is the better guess.
_AS_GOOD = 0.8


@dataclass(frozen=True, eq=False)
class Outcome:
    """Findings without an effect, and the chosen effects that remain beside them."""

    findings: tuple[Finding, ...]
    chosen: tuple[Candidate, ...]


def by_another_law(scale: Scale, alternative: Alternative,
                   chosen: Sequence[Candidate]) -> Outcome:
    """Return the finding of a cause that follows another law than its effect."""
    helped = (alternative.before - alternative.after).sum(axis=0)
    joint, trial = int(np.argmax(helped)), alternative.trial
    effect = alternative.model.effect
    was_chosen = len(alternative.without) < len(chosen)
    criteria = scale.criteria
    rest = tuple(
        c for c in alternative.without if c.joint != trial.joint
        or criteria.is_needed(c, [*(o for o in alternative.without if o is not c), trial]))
    before, after = (scale.nrmse_of(errors[:, joint], joint)
                     for errors in (alternative.before, alternative.after))
    name = scale.names[trial.place]
    finding = Finding(
        name, None, Verdict.UNEXPLAINED, (effect.name,) if was_chosen else (), {},
        before, after, 0.0, scale.runs_better(alternative.gain),
        f'it resembles {effect.name}, but another law explains '
        f'{alternative.gain.share:.1%} more of the held-out error: {alternative.model.meaning}',
        effect.experiment.replace('{joint}', name), alternative.gain.p)
    return Outcome((finding,), rest)


def of_unknown_shape(scale: Scale, joint: int, chosen: tuple[Candidate, ...],
                     shapes: Sequence[Trial[UnknownTorque]],
                     refused: dict[tuple[str, int | None], str]) -> Outcome:
    """Return a finding where bumps explain what effects do not; drop effects that pose."""
    nothing = Outcome((), chosen)
    here = [c for c in shapes if c.joint == joint]
    if not here:
        return nothing
    fits = scale.criteria.fits
    with_each = fits.errors_with_each(joint, chosen, here)
    every, unknown = min(zip(with_each, here), key=lambda pair: float(pair[0].sum()))
    posing = [c for c in chosen if c.joint == joint and not c.shared]
    rest = tuple(c for c in chosen if c not in posing)
    none, some = (fits.errors(joint, c) for c in (rest, chosen))
    left = gain_in_few_blocks(some, every, len(shapes))
    if left.p >= _STRUCTURE_ALPHA or left.share < _STRUCTURE_SHARE:
        return nothing
    mostly = float((some - every).sum()) > 0.5 * float((none - every).sum())
    if not mostly and left.share < _REMAINDER_SHARE:
        return nothing
    hint = _hint(scale, joint, chosen, refused, some, float(every.sum()))
    if hint is not None:
        return Outcome((hint,), chosen)
    angle = largest_angle(
        scale.motion.samples.q[:, joint], fits.coefficients(unknown, [*chosen, unknown]),
        int(unknown.setting['bumps']))
    name = scale.names[joint]
    finding = Finding(
        name, None, Verdict.UNEXPLAINED,
        tuple(sorted({c.effect.name for c in posing})) if mostly else (), {},
        scale.nrmse_of(some, joint), scale.nrmse_of(every, joint), 0.0,
        scale.runs_better(left),
        f'{left.share:.0%} of the held-out error repeats with the angle of the joint, most of '
        f'it near {angle:.2f} rad, and no effect of the library describes it',
        f'Look at joint {name} near {angle:.2f} rad: a detent, a cable that catches, a damaged '
        f'gear or bearing', left.p, {'angle': angle})
    return Outcome((finding,), rest if mostly else chosen)


def _hint(scale: Scale, joint: int, chosen: Sequence[Candidate],
          refused: dict[tuple[str, int | None], str], now: FloatArray,
          unexplained: float) -> Finding | None:
    """
    Return the effect, too weak to be sure of, that does what an unknown torque would do.

    :param unexplained: the joint's error with an unknown torque of angle and direction.
    """
    criteria = scale.criteria
    candidates = criteria.open_on(joint, chosen, refused)
    if not candidates:
        return None
    errors = criteria.fits.errors_with_each(joint, chosen, candidates)
    then, best = min(zip(errors, candidates), key=lambda pair: float(pair[0].sum()))
    removed = float(now.sum() - then.sum())
    if removed < _AS_GOOD * (float(now.sum()) - unexplained):
        return None
    seen = gain(now, then, criteria.tests(best))
    before, after = (scale.nrmse_of(e, joint) for e in (now, then))
    name = scale.names[joint]
    return Finding(
        name, best.effect.name, Verdict.WEAK, (), {}, before, after, scale.absorbed(best),
        scale.runs_better(seen),
        evidence_sentence(best.effect.title, name, before, after, seen.p),
        best.effect.experiment.replace('{joint}', name), seen.p, dict(best.setting))
