"""
Whether a recording keeps the laws that the gravity of a serial arm obeys.

A law is tested with columns that only its breach could use, on data that was not fitted. Which
law breaks narrows what is missing down before any effect has a name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.evaluation.gain import Gain, gain

_ALPHA = 0.01
# A breach that takes less than this off a joint's error changes no mind.
_LEAST_SHARE = 0.1
# An error below this share of the torque of a joint breaks no law: it is rounding.
_LEAST_ERROR = 1e-4


@dataclass(frozen=True)
class BrokenLaw:
    """
    A law that a joint breaks, once the effects are counted that were named and do not break it.

    `holds_with_effects` says whether those that do break it, among them `suspects`, make up for
    it. `p` is the chance of the evidence against the law, `share` the part of the held-out
    error that its breach takes off.
    """

    law: str
    joint: str
    holds_with_effects: bool
    p: float
    share: float
    words: str
    suspects: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the report as `diagnose --json` prints it."""
        return {'law': self.law, 'joint': self.joint, 'holds': False,
                'holds_with_effects': self.holds_with_effects, 'p': self.p,
                'share': self.share, 'why': self.words, 'suspects': list(self.suspects)}


def check_laws(fits: Fits, chosen: Sequence[Candidate],
               names: tuple[str, ...]) -> tuple[BrokenLaw, ...]:
    """Return the laws that are broken, joint by joint."""
    broken, laws = [], fits.layout.laws
    for trial in laws:
        joint, law = trial.place, trial.regressor
        if _is_rounding(fits, joint, chosen):
            continue
        innocent = [c for c in chosen if c.effect.name not in law.suspects]
        reports = []
        for beside in (innocent, chosen):
            after, = fits.errors_with_each(joint, beside, [trial])
            reports.append(gain(fits.errors(joint, beside), after, len(laws)))
        bare, named = reports
        if _is_kept(bare):
            continue
        words = f'{law.breach} on joint {names[joint]}: {bare.share:.0%} of the held-out error'
        broken.append(BrokenLaw(law.name, names[joint], _is_kept(named), bare.p, bare.share,
                                words, law.suspects))
    return tuple(broken)


def _is_rounding(fits: Fits, joint: int, chosen: Sequence[Candidate]) -> bool:
    y = fits.rows[joint].y
    return bool(fits.errors(joint, chosen).sum() < _LEAST_ERROR ** 2 * float(y @ y))


def _is_kept(evidence: Gain) -> bool:
    return bool(evidence.p >= _ALPHA or evidence.share < _LEAST_SHARE)
