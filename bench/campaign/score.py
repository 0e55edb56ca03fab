"""Score of a diagnosis: its findings against the truth of a hidden-effect case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.cases.cases import Case, Pair, Truth
from gravity_comp_ros.effects.rigid_body import DYNAMICS


# Verdicts that are findings; the others report an unresolved effect.
ACCEPTED = ('established', 'likely')
# Effects of every simulated recording, since links have inertia; naming them is never false.
ALWAYS_THERE = frozenset((DYNAMICS,))


@dataclass(frozen=True)
class Interval:
    """A coefficient's 95 % interval and its true value."""

    effect: str
    truth: float
    value: float
    low: float
    high: float

    @property
    def covers(self) -> bool:
        return self.low <= self.truth <= self.high


@dataclass(frozen=True)
class Score:
    """
    Score of one diagnosis.

    `named` has one entry for each truth. `false` lists findings without a true effect. `right` is
    whether the diagnosis finds all truths, or calls them untestable, and has no false finding.
    """

    named: tuple[bool, ...]
    false: tuple[str, ...]
    intervals: tuple[Interval, ...]
    right: bool


def score(case: Case, diagnosis: Mapping[str, Any], joints: Sequence[str]) -> Score:
    """
    Return the score of the output of `diagnose --json` on a case.

    :param joints: the arm's joint names in order.
    """
    findings = [Finding.of(entry, joints) for entry in diagnosis['findings']]
    accepted = [finding for finding in findings if finding.accepted]
    named = tuple(any(finding.names(truth) for finding in findings) for truth in case.truths)
    false = tuple(str(finding) for finding in accepted if not finding.is_among(case))
    intervals = tuple(interval for truth in case.truths for finding in accepted
                      for interval in finding.intervals(truth))
    right = _called_untestable(case, findings, diagnosis, joints) if case.untestable \
        else all(named)
    return Score(named, false, intervals, right and not false)


@dataclass(frozen=True)
class Finding:
    """One finding, with its joint as an index from 0."""

    effect: str | None
    joint: int | None
    verdict: str
    rivals: tuple[Pair, ...]
    coefficients: tuple[tuple[float, str, float, float], ...]

    @classmethod
    def of(cls, entry: Mapping[str, Any], joints: Sequence[str]) -> Finding:
        joint = None if entry['joint'] is None else joints.index(entry['joint'])
        coefficients = tuple((c['value'], c['unit'], *c['ci95'])
                             for c in entry['coefficients'].values())
        return cls(entry['effect'], joint, entry['verdict'],
                   tuple(_alternative(text, joint, joints) for text in entry['rivals']),
                   coefficients)

    def __str__(self) -> str:
        where = 'arm' if self.joint is None else str(self.joint + 1)
        alternatives = ''.join(f' or {name}' for name, _ in self.rivals)
        return f'{self.effect or "unexplained"}:{where} ({self.verdict}){alternatives}'

    @property
    def accepted(self) -> bool:
        return self.verdict in ACCEPTED and self.effect is not None

    def is_among(self, case: Case) -> bool:
        """Return whether the effect is in the recording, expected or only allowed."""
        if self.effect in ALWAYS_THERE:
            return True
        true_pairs = case.expected | case.allowed
        return any(_same((self.effect, self.joint), pair) for pair in true_pairs)

    def names(self, truth: Truth) -> bool:
        """Return whether it names a truth, alone or as one of ambiguous alternatives."""
        if self.effect is None or self.verdict not in (*ACCEPTED, 'ambiguous'):
            return False
        pairs = [(self.effect, self.joint)]
        if self.verdict == 'ambiguous':
            pairs += self.rivals
        return any(_same(pair, answer) for pair in pairs for answer in truth.answers)

    def intervals(self, truth: Truth) -> list[Interval]:
        if not _same((self.effect, self.joint), (truth.effect, truth.joint)):
            return []
        return [Interval(truth.effect, true, value, low, high)
                for true, (value, unit, low, high) in zip(truth.values, self.coefficients)
                if unit == truth.unit]


def _alternative(text: str, joint: int | None, joints: Sequence[str]) -> Pair:
    effect, _, where = text.partition(':')
    return effect, joints.index(where) if where in joints else joint


def _same(named: tuple[str | None, int | None], true: Pair) -> bool:
    return named[0] == true[0] and (true[1] is None or named[1] == true[1])


def _called_untestable(case: Case, findings: Sequence[Finding], diagnosis: Mapping[str, Any],
                       joints: Sequence[str]) -> bool:
    """Return whether the truths are reported as ambiguous, or all as untestable."""
    names = {truth.effect for truth in case.truths}
    true_joints = {truth.joint for truth in case.truths}
    related = [f for f in findings if f.joint in true_joints and f.effect in names]
    if any(f.accepted for f in related):
        return False
    for finding in related:
        alternatives = {finding.effect, *(effect for effect, _ in finding.rivals)}
        if finding.verdict in ('untestable', 'ambiguous') and names <= alternatives:
            return True
    reported = [diagnosis['joints'][joints[joint]].get('untestable', {})
                for joint in true_joints if joint is not None]
    untestable = {f.effect for f in related if f.verdict == 'untestable'}
    return any(names <= untestable | set(reasons) for reasons in reported)
