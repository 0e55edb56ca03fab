"""
Test of a recording against the structural laws of a serial arm's gravity.

A law is tested on held-out data with columns that are excluded by the law. The law that is
violated narrows down the cause before an effect is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.evaluation.gain import Gain, gain

_ALPHA = 0.01
# Minimum share of a joint's held-out error that counts as a violation.
_MIN_SHARE = 0.1


@dataclass(frozen=True)
class StructureViolation:
    """
    A law that a joint violates, with the chosen effects that cannot violate it in the model.

    `holds_with_effects` is True if the chosen effects among `suspects` explain the violation.
    `p` is its p-value, `share` the reduction of the held-out error by the excluded columns.
    """

    law: str
    joint: str
    holds_with_effects: bool
    p: float
    share: float
    sentence: str
    suspects: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the report as `diagnose --json` prints it."""
        return {'law': self.law, 'joint': self.joint, 'holds': False,
                'holds_with_effects': self.holds_with_effects, 'p': self.p,
                'share': self.share, 'why': self.sentence, 'suspects': list(self.suspects)}


def check_structure(fits: Fits, chosen: Sequence[Candidate],
                    names: tuple[str, ...]) -> tuple[StructureViolation, ...]:
    """Return the violated laws of every joint."""
    violations, tests = [], fits.layout.structure_tests
    for trial in tests:
        joint, test = trial.joint_index, trial.regressor
        if fits.is_rounding_error(joint, chosen):
            continue
        compatible = [c for c in chosen if c.effect.name not in test.suspects]
        gains = []
        for effects in (compatible, chosen):
            after, = fits.errors_with_each(joint, effects, [trial])
            gains.append(gain(fits.errors(joint, effects), after, len(tests)))
        without, with_suspects = gains
        if _is_satisfied(without):
            continue
        sentence = f'{test.violation} on joint {names[joint]}: {without.share:.0%} of the ' \
            'held-out error'
        violations.append(StructureViolation(
            test.name, names[joint], _is_satisfied(with_suspects), without.p, without.share,
            sentence, test.suspects))
    return tuple(violations)


def _is_satisfied(evidence: Gain) -> bool:
    return bool(evidence.p >= _ALPHA or evidence.share < _MIN_SHARE)
