"""
Tests of alternative models: other torque laws of the same physical cause.

A compliant gear and a gear with backlash produce similar torques. An effect is not named if the
columns of its alternative model explain more of the held-out error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate, Trial
from gravity_comp_ros.diagnosis.criteria import Criteria
from gravity_comp_ros.effects.effect import AlternativeModel
from gravity_comp_ros.evaluation.gain import Gain, gain


@dataclass(frozen=True, eq=False)
class Alternative:
    """
    An alternative model that explains more than its effect.

    `without` are the chosen effects except that effect. `before` and `after` (B, N) are the
    held-out errors of the chosen effects, and with the alternative in place of the effect.
    """

    trial: Trial[AlternativeModel]
    without: tuple[Candidate, ...]
    before: FloatArray
    after: FloatArray
    gain: Gain

    @property
    def model(self) -> AlternativeModel:
        return self.trial.regressor


def best_alternative_model(criteria: Criteria, trials: Sequence[Trial[AlternativeModel]],
                           chosen: Sequence[Candidate]) -> Alternative | None:
    """Return the alternative model with the largest gain over the chosen effects, if any."""
    better = [alternative for trial in trials
              if (alternative := _alternative(criteria, trial, chosen, len(trials))) is not None]
    return max(better, key=lambda alternative: alternative.gain.mean, default=None)


def _alternative(criteria: Criteria, trial: Trial[AlternativeModel],
                 chosen: Sequence[Candidate], tests: int) -> Alternative | None:
    effect = trial.regressor.effect.name
    without = tuple(c for c in chosen if c.key != (effect, trial.joint))
    before = criteria.fits.errors(None, chosen)
    after, = criteria.fits.errors_with_each(None, without, [trial])
    more = gain(before, after, tests)
    if (more.p >= criteria.options.alpha or more.share <= criteria.min_share(trial)
            or not criteria.exceeds_dynamics(trial, chosen)):
        return None
    return Alternative(trial, without, before, after, more)
