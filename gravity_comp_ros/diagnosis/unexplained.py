"""
Torque that no effect of the library describes, but that repeats with the angle of a joint.

The residual of the estimate is compared with bumps over the angle, by the same criterion as the
effects: a column of Gaussian bumps with a prior of a few percent of the torque.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.findings import Finding, Verdict
from gravity_comp_ros.diagnosis.verdict import Evidence
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.regression.gains import gain, p_of, score_of
from gravity_comp_ros.regression.term import Term
import numpy as np

# Number of bumps over the range of a joint, and prior standard deviation of each as a share of
# the torque scale.
_BUMPS, _SIZE = 24, 0.03


def unexplained(evidence: Evidence) -> list[Finding]:
    """Return a finding for each joint whose residual repeats with its angle."""
    regression = evidence.estimated.regression
    problem, options = regression.problem, regression.problem.options
    findings = []
    for n, name in enumerate(evidence.joints):
        q = problem.rows.mean(problem.samples.q[:, n])
        if np.ptp(q) <= FactOptions().min_travel:
            continue
        bumps, centres = _bumps(q)
        std = np.full(_BUMPS, _SIZE * float(problem.scale.torque[n]))
        # The effect of the term is not used by the score.
        term = Term(_NoEffect(), n, {}, bumps, std, -np.log(1e3))  # type: ignore[arg-type]
        scored = score_of(regression.posterior, term)
        value = gain(regression.posterior, scored)
        if value < options.min_gain:
            continue
        torque = bumps @ scored.mean
        span = max(float(np.ptp(evidence.torques.tau[:, n])), 1e-12)
        every = {*evidence.predicted, *evidence.torques.effects}
        before = float(evidence.torques.rmse(every)[n])
        after = float(np.sqrt(max(before ** 2 - float((torque ** 2).mean()), 0.0)))
        if before - after < evidence.options.min_remaining * before:
            continue
        angle = float(centres[int(np.argmax(np.abs(scored.mean)))])
        findings.append(Finding(
            name, None, Verdict.UNEXPLAINED, (), {}, before / span, after / span,
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

    name, why_not_negative, corrects, is_static = 'unexplained', '', (), True
