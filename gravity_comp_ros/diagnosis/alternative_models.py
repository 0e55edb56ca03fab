"""
Alternative models of a cause: the same cause, acting by another law than that of the effect.

A gear that yields in proportion to its load and one with play turn the link alike, and either is
much of what the other would be. Where the columns of the alternative explain more than those of
the effect, the effect is not named, though it may help.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.criteria import Criteria
from gravity_comp_ros.effects.effect import always_plausible, Effect
from gravity_comp_ros.evaluation.gain import Gain, gain

FAMILY = 'other law'


def alternatives_of(effects: Mapping[str, Effect]) -> dict[str, Effect]:
    """Return the alternative model, never to be named, of each effect that has one."""
    return {f'other than {name}': replace(
        effect, name=f'other than {name}', family=FAMILY, columns=effect.otherwise.columns,
        implausible=always_plausible, confounders=(name,))
        for name, effect in effects.items() if effect.otherwise is not None}


@dataclass(frozen=True, eq=False)
class Alternative:
    """
    An alternative model that explains more than its effect does.

    `effect` is the name of the effect, `words` say what the alternative means, `without` are the
    chosen effects without it; `before` and `after` (B, N) are the held-out errors of what was
    chosen and of the alternative in its place.
    """

    candidate: Candidate
    effect: str
    words: str
    without: tuple[Candidate, ...]
    before: FloatArray
    after: FloatArray
    gain: Gain


def best_alternative(criteria: Criteria, candidates: Sequence[Candidate],
                     chosen: Sequence[Candidate]) -> Alternative | None:
    """Return the alternative model that explains most beyond all that was chosen, if any."""
    found = [one for c in candidates
             if (one := _alternative(criteria, c, chosen, len(candidates))) is not None]
    return max(found, key=lambda one: one.gain.mean, default=None)


def _alternative(criteria: Criteria, candidate: Candidate, chosen: Sequence[Candidate],
                 tests: int) -> Alternative | None:
    effect, = candidate.effect.confounders
    without = tuple(c for c in chosen if c.key != (effect, candidate.joint))
    before = criteria.fits.errors(None, chosen)
    after, = criteria.fits.errors_with_each(None, without, [candidate])
    more = gain(before, after, tests)
    if more.p >= criteria.options.alpha or more.share <= criteria.least_share(candidate):
        return None
    if not criteria.is_more_than_motion(candidate, chosen):
        return None
    words = candidate.effect.otherwise.words if candidate.effect.otherwise else ''
    return Alternative(candidate, effect, words, without, before, after, more)
