"""
Alternative models of a cause: the same cause, acting by another law than that of the effect.

A gear that yields in proportion to its load and one with play turn the link alike, and either is
much of what the other would be. Where the columns of the alternative explain more than those of
the effect, the effect is not named, though it may help.
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
    An alternative model that explains more than its effect does.

    `without` are the chosen effects without that effect; `before` and `after` (B, N) are the
    held-out errors of what was chosen and of the alternative in its place.
    """

    trial: Trial[AlternativeModel]
    without: tuple[Candidate, ...]
    before: FloatArray
    after: FloatArray
    gain: Gain

    @property
    def model(self) -> AlternativeModel:
        return self.trial.regressor


def best_alternative(criteria: Criteria, trials: Sequence[Trial[AlternativeModel]],
                     chosen: Sequence[Candidate]) -> Alternative | None:
    """Return the alternative model that explains most beyond all that was chosen, if any."""
    found = [one for trial in trials
             if (one := _alternative(criteria, trial, chosen, len(trials))) is not None]
    return max(found, key=lambda one: one.gain.mean, default=None)


def _alternative(criteria: Criteria, trial: Trial[AlternativeModel],
                 chosen: Sequence[Candidate], tests: int) -> Alternative | None:
    effect = trial.regressor.effect.name
    without = tuple(c for c in chosen if c.key != (effect, trial.joint))
    before = criteria.fits.errors(None, chosen)
    after, = criteria.fits.errors_with_each(None, without, [trial])
    more = gain(before, after, tests)
    if more.p >= criteria.options.alpha or more.share <= criteria.least_share(trial):
        return None
    if not criteria.is_more_than_motion(trial, chosen):
        return None
    return Alternative(trial, without, before, after, more)
