"""Findings without a named effect: an alternative model, or a torque of unknown shape."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.alternative_models import Alternative
from gravity_comp_ros.diagnosis.candidates import Candidate, Trial
from gravity_comp_ros.diagnosis.error_metrics import ErrorMetrics
from gravity_comp_ros.diagnosis.findings import Finding, Verdict
from gravity_comp_ros.diagnosis.nonparametric import largest_angle, UnknownTorque
from gravity_comp_ros.diagnosis.wording import evidence_sentence
from gravity_comp_ros.evaluation.gain import gain, gain_in_few_blocks
import numpy as np

# Minimum reduction of the remaining error by an unknown torque, and maximum p-value: it acts in
# the few blocks that pass its angle, so that its mean gain is uncertain.
_MIN_SHARE = 0.05
_ALPHA = 0.05
# The same if most of the error is explained by named effects.
_MIN_REMAINING_SHARE = 0.3
# Minimum reduction by an effect, relative to that of the unknown torque, for it to be named.
_COMPARABLE = 0.8

Chosen = tuple[Candidate, ...]


def finding_of_alternative_model(metrics: ErrorMetrics, alternative: Alternative,
                                 chosen: Sequence[Candidate]) -> tuple[Finding, Chosen]:
    """Return the finding of a torque that follows an alternative model; and other effects."""
    reduction = (alternative.before - alternative.after).sum(axis=0)
    joint, trial = int(np.argmax(reduction)), alternative.trial
    effect = alternative.model.effect
    was_chosen = len(alternative.without) < len(chosen)
    criteria = metrics.criteria
    needed = tuple(
        c for c in alternative.without if c.joint != trial.joint
        or criteria.is_needed(c, [*(o for o in alternative.without if o is not c), trial]))
    before, after = (metrics.nrmse_of(errors[:, joint], joint)
                     for errors in (alternative.before, alternative.after))
    name = metrics.names[trial.joint_index]
    return Finding(
        name, None, Verdict.UNEXPLAINED, (effect.name,) if was_chosen else (), {},
        before, after, 0.0, metrics.runs_better(alternative.gain),
        f'it resembles {effect.name}, but another model reduces the held-out error by '
        f'{alternative.gain.share:.1%} more: {alternative.model.meaning}',
        effect.experiment.replace('{joint}', name), alternative.gain.p), needed


def finding_of_unknown_torque(metrics: ErrorMetrics, joint: int, chosen: Chosen,
                              unknown: Sequence[Trial[UnknownTorque]],
                              refused: dict[tuple[str, int | None], str]
                              ) -> tuple[Finding | None, Chosen]:
    """
    Return the finding of a torque of unknown shape on a joint, if any; and the other effects.

    The joint's own effects are dropped if the unknown torque explains most of what they explain.
    """
    here = [c for c in unknown if c.joint == joint]
    fits = metrics.criteria.fits
    if not here or fits.is_rounding_error(joint, chosen):
        return None, chosen
    with_each = fits.errors_with_each(joint, chosen, here)
    with_unknown, trial = min(zip(with_each, here), key=lambda pair: float(pair[0].sum()))
    superseded = [c for c in chosen if c.joint == joint and not c.shared]
    rest = tuple(c for c in chosen if c not in superseded)
    without, with_effects = (fits.errors(joint, c) for c in (rest, chosen))
    evidence = gain_in_few_blocks(with_effects, with_unknown, len(unknown))
    if evidence.p >= _ALPHA or evidence.share < _MIN_SHARE:
        return None, chosen
    dominant = (float((with_effects - with_unknown).sum())
                > 0.5 * float((without - with_unknown).sum()))
    if not dominant and evidence.share < _MIN_REMAINING_SHARE:
        return None, chosen
    weak = _weak_effect(metrics, joint, chosen, refused, with_effects, float(with_unknown.sum()))
    if weak is not None:
        return weak, chosen
    angle = largest_angle(
        metrics.motion.samples.q[:, joint], fits.coefficients(trial, [*chosen, trial]),
        int(trial.setting['bumps']))
    name = metrics.names[joint]
    finding = Finding(
        name, None, Verdict.UNEXPLAINED,
        tuple(sorted({c.effect.name for c in superseded})) if dominant else (), {},
        metrics.nrmse_of(with_effects, joint), metrics.nrmse_of(with_unknown, joint), 0.0,
        metrics.runs_better(evidence),
        f'{evidence.share:.0%} of the held-out error is a function of the joint angle, largest '
        f'near {angle:.2f} rad, and no effect of the library describes it',
        f'inspect joint {name} near {angle:.2f} rad for a detent, a caught cable, or a damaged '
        f'gear or bearing', evidence.p, {'angle': angle})
    return finding, rest if dominant else chosen


def _weak_effect(metrics: ErrorMetrics, joint: int, chosen: Sequence[Candidate],
                 refused: dict[tuple[str, int | None], str], before: FloatArray,
                 unknown_error: float) -> Finding | None:
    """
    Return a weak finding of an effect that explains about as much as the unknown torque.

    :param before: errors (B, 1) of the joint with the chosen effects.
    :param unknown_error: squared error of the joint with the unknown torque in addition.
    """
    criteria = metrics.criteria
    candidates = criteria.available_on(joint, chosen, refused)
    if not candidates:
        return None
    errors = criteria.fits.errors_with_each(joint, chosen, candidates)
    after, best = min(zip(errors, candidates), key=lambda pair: float(pair[0].sum()))
    removed = float(before.sum() - after.sum())
    if removed < _COMPARABLE * (float(before.sum()) - unknown_error):
        return None
    evidence = gain(before, after, criteria.n_tests(best))
    nrmse_before, nrmse_after = (metrics.nrmse_of(e, joint) for e in (before, after))
    name = metrics.names[joint]
    return Finding(
        name, best.effect.name, Verdict.WEAK, (), {}, nrmse_before, nrmse_after,
        criteria.fits.absorbed(best), metrics.runs_better(evidence),
        evidence_sentence(best.effect.title, name, nrmse_before, nrmse_after, evidence.p),
        best.effect.experiment.replace('{joint}', name), evidence.p, dict(best.setting))
