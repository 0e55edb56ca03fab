"""Findings of a diagnosis against the true effects of a recording."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gravity_comp_ros.effects.rigid_body import DYNAMICS
import numpy as np

Pair = tuple[str, int | None]
"""An effect and its joint, counted from 0; None for the whole arm, or any joint."""

# Verdicts that are findings; the others report an unresolved effect.
ACCEPTED = ('established', 'likely')
# Effects of every simulated recording, since links have inertia; naming them is never false.
ALWAYS_THERE = frozenset((DYNAMICS,))


@dataclass(frozen=True)
class Known:
    """The first coefficient in `unit` of an effect on a joint, between `low` and `high`."""

    effect: str
    joint: int
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class Finding:
    """An entry of `diagnose --json`, with its joint as an index from 0."""

    effect: str | None
    joint: int | None
    verdict: str
    rivals: tuple[Pair, ...]
    coefficients: tuple[tuple[str, float, float], ...]

    @classmethod
    def of(cls, entry: Mapping[str, Any], joints: Sequence[str]) -> Finding:
        joint = None if entry['joint'] is None else joints.index(entry['joint'])
        alternatives = (text.partition(':') for text in entry['rivals'])
        return cls(entry['effect'], joint, entry['verdict'],
                   tuple((effect, joints.index(where) if where in joints else joint)
                         for effect, _, where in alternatives),
                   tuple((c['unit'], *c['ci95']) for c in entry['coefficients'].values()))

    def __str__(self) -> str:
        where = 'arm' if self.joint is None else str(self.joint + 1)
        alternatives = ''.join(f' or {name}' for name, _ in self.rivals)
        return f'{self.effect or "unexplained"}:{where} ({self.verdict}){alternatives}'

    @property
    def accepted(self) -> bool:
        return self.verdict in ACCEPTED and self.effect is not None

    def is_one_of(self, pairs: Iterable[Pair]) -> bool:
        """Return whether it is an effect on a joint of these pairs."""
        return any(self.effect == effect and joint in (None, self.joint)
                   for effect, joint in pairs)

    def names(self, pairs: Collection[Pair]) -> bool:
        """Return whether it names one of these pairs, alone or as one of several alternatives."""
        if self.verdict != 'ambiguous':
            return self.accepted and self.is_one_of(pairs)
        return self.is_one_of(pairs) or any(
            (effect, at) in pairs for effect, joint in self.rivals for at in (joint, None))


@dataclass(frozen=True)
class Coverage:
    """A published 95 % interval, the true coefficient, and whether they overlap."""

    what: str
    ci95: tuple[float, float]
    true: tuple[float, float]
    covers: bool


def coverage(findings: Iterable[Finding], known: Iterable[Known]) -> tuple[Coverage, ...]:
    """Return the intervals of accepted findings whose true coefficients are known."""
    out = []
    for truth in known:
        for finding in findings:
            if finding.accepted and (finding.effect, finding.joint) == (truth.effect, truth.joint):
                # A spring may have a constant as well.
                out += [Coverage(f'{truth.effect}:{truth.joint + 1}', (low, high),
                                 (truth.low, truth.high), low <= truth.high and high >= truth.low)
                        for unit, low, high in finding.coefficients
                        if unit == truth.unit and np.isfinite((low, high)).all()][:1]
    return tuple(out)


def false_findings(findings: Iterable[Finding], present: Collection[Pair]) -> tuple[str, ...]:
    """Return the accepted findings that are not among the pairs that are present."""
    return tuple(str(f) for f in findings if f.accepted and f.effect not in ALWAYS_THERE
                 and not f.is_one_of(present))
