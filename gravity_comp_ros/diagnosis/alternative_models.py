"""
Effects by another law than their own.

A gear that gives way in proportion to its load and one with play turn the link alike, and either
is much of what the other would be. Where the columns of another law explain more than those of
the effect, the effect is not what is there, though it may help.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.selection import Selection
from gravity_comp_ros.effects.effect import always_plausible, Effect
from gravity_comp_ros.evaluation.gain import Gain, gain

FAMILY = 'other law'


def other_laws(effects: Mapping[str, Effect]) -> dict[str, Effect]:
    """Return a stand-in, never to be named, for each effect that has another law."""
    return {f'other than {name}': replace(
        effect, name=f'other than {name}', family=FAMILY, columns=effect.otherwise.columns,
        implausible=always_plausible, confounders=(name,))
        for name, effect in effects.items() if effect.otherwise is not None}


@dataclass(frozen=True)
class Bent:
    """
    A stand-in that explains more than its effect does.

    `effect` is what it stands in for, `words` say what that means, `without` are the chosen
    effects without it; `before` and `after` (B, N) are the held-out errors of what was chosen
    and of the stand-in in its place.
    """

    candidate: Candidate
    effect: str
    words: str
    without: list[Candidate]
    before: FloatArray
    after: FloatArray
    gain: Gain


def bent(selection: Selection, candidate: Candidate, tests: int) -> Bent | None:
    """Return what a stand-in explains beyond all that was chosen, None if that is too little."""
    effect, = candidate.effect.confounders
    without = [c for c in selection.chosen if c.key != (effect, candidate.joint)]
    before = selection.errors(None, selection.chosen)
    after = selection.errors(None, [*without, candidate])
    more = gain(before, after, tests)
    if more.p >= selection.options.alpha or more.share <= selection.least_share(candidate):
        return None
    if not selection.is_more_than_motion(candidate, selection.chosen):
        return None
    words = candidate.effect.otherwise.words if candidate.effect.otherwise else ''
    return Bent(candidate, effect, words, without, before, after, more)
