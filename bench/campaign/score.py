"""What a diagnosis got right: findings against the truth of a hidden-effect case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bench.cases.cases import Case, Pair, Truth


# `established` and `likely` are findings; the other verdicts say that something is open.
SURE = ('established', 'likely')
# The arm in these recordings moves and has a mass, so whoever names these is right.
ALWAYS_THERE = frozenset(('inertia', 'coriolis', 'rigid_body_dynamics'))


@dataclass(frozen=True)
class Interval:
    """A coefficient's 95 % interval beside its true value."""

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
    One diagnosis judged.

    `named` has one entry a truth; `false` the sure findings that are not there, `open` those
    that are called ambiguous, weak, untestable or unexplained. `right` is the judgement by
    the case's verdict.
    """

    named: tuple[bool, ...]
    false: tuple[str, ...]
    open: tuple[str, ...]
    intervals: tuple[Interval, ...]
    right: bool


def score(case: Case, diagnosis: Mapping[str, Any], joints: Sequence[str]) -> Score:
    """
    Judge what `diagnose --json` says of a case.

    :param joints: the arm's joint names in order.
    """
    findings = [Found.of(entry, joints) for entry in diagnosis['findings']]
    sure = [found for found in findings if found.sure]
    named = tuple(any(found.names(truth) for found in findings) for truth in case.truths)
    false = tuple(str(found) for found in sure if not found.is_among(case))
    still_open = tuple(str(found) for found in findings if not found.sure)
    intervals = tuple(interval for truth in case.truths for found in sure
                      for interval in found.intervals(truth))
    right = not false and _by_verdict(case, findings, named, diagnosis, joints)
    return Score(named, false, still_open, intervals, right)


@dataclass(frozen=True)
class Found:
    """One finding, its joint as a number from 0."""

    effect: str | None
    joint: int | None
    verdict: str
    rivals: tuple[Pair, ...]
    coefficients: tuple[tuple[float, str, float, float], ...]

    @classmethod
    def of(cls, entry: Mapping[str, Any], joints: Sequence[str]) -> Found:
        joint = None if entry['joint'] is None else joints.index(entry['joint'])
        coefficients = tuple((c['value'], c['unit'], *c['ci95'])
                             for c in entry['coefficients'].values())
        return cls(entry['effect'], joint, entry['verdict'],
                   tuple(_rival(text, joint, joints) for text in entry['rivals']), coefficients)

    def __str__(self) -> str:
        where = 'arm' if self.joint is None else str(self.joint + 1)
        rivals = ''.join(f' or {name}' for name, _ in self.rivals)
        return f'{self.effect or "something"}:{where} ({self.verdict}){rivals}'

    @property
    def sure(self) -> bool:
        return self.verdict in SURE and self.effect is not None

    def is_among(self, case: Case) -> bool:
        """Tell whether what it names is there, asked for or not."""
        if self.effect in ALWAYS_THERE:
            return True
        there = case.expected | case.allowed
        return any(_same((self.effect, self.joint), pair) for pair in there)

    def names(self, truth: Truth) -> bool:
        """Tell whether it names a truth, alone or as one of several that look the same."""
        if self.effect is None or self.verdict not in (*SURE, 'ambiguous'):
            return False
        said = [(self.effect, self.joint)]
        if self.verdict == 'ambiguous':
            said += self.rivals
        return any(_same(pair, answer) for pair in said for answer in truth.answers)

    def intervals(self, truth: Truth) -> list[Interval]:
        if not _same((self.effect, self.joint), (truth.effect, truth.joint)):
            return []
        return [Interval(truth.effect, true, value, low, high)
                for true, (value, unit, low, high) in zip(truth.values, self.coefficients)
                if unit == truth.unit]


def _rival(text: str, joint: int | None, joints: Sequence[str]) -> Pair:
    effect, _, where = text.partition(':')
    return effect, joints.index(where) if where in joints else joint


def _same(said: tuple[str | None, int | None], true: Pair) -> bool:
    return said[0] == true[0] and (true[1] is None or said[1] == true[1])


def _by_verdict(case: Case, findings: Sequence[Found], named: tuple[bool, ...],
                diagnosis: Mapping[str, Any], joints: Sequence[str]) -> bool:
    if case.verdict == 'found':
        return all(named)
    if case.verdict == 'unexplained':
        places = {truth.joint for truth in case.truths}
        return any(f.verdict == 'unexplained' and f.joint in places for f in findings)
    if case.verdict == 'untestable':
        return _called_untestable(case, findings, diagnosis, joints)
    return True


def _called_untestable(case: Case, findings: Sequence[Found], diagnosis: Mapping[str, Any],
                       joints: Sequence[str]) -> bool:
    """Tell whether the truths are said to look the same, or all to be untestable here."""
    names = {truth.effect for truth in case.truths}
    places = {truth.joint for truth in case.truths}
    here = [f for f in findings if f.joint in places and f.effect in names]
    if any(f.sure for f in here):
        return False
    for found in here:
        said = {found.effect, *(effect for effect, _ in found.rivals)}
        if found.verdict in ('untestable', 'ambiguous') and names <= said:
            return True
    reported = [diagnosis['joints'][joints[place]].get('untestable', {})
                for place in places if place is not None]
    untestable = {f.effect for f in here if f.verdict == 'untestable'}
    return any(names <= untestable | set(reasons) for reasons in reported)
