"""Outcome of a plan: the verdict of a later diagnosis on each target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, FOUND
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.planning.options import Target

# No finding, with recordings that excite the effect.
ABSENT = 'absent'
UNTESTABLE = 'untestable'
RESOLVED = (*map(str, FOUND), ABSENT)


def finding_of(target: Target, diagnosis: Diagnosis | None) -> Finding | None:
    """Return the finding of a target, None if there is none."""
    return next((f for f in (diagnosis.findings if diagnosis else ())
                 if (f.effect, f.joint) == (target.effect, target.joint)), None)


def outcome(target: Target, diagnosis: Diagnosis) -> str:
    """Return the verdict on a target, `absent` or `untestable`."""
    finding = finding_of(target, diagnosis)
    if finding is not None:
        return str(finding.verdict)
    reasons = (diagnosis if target.joint is None else diagnosis.joints[target.joint]).untestable
    return UNTESTABLE if target.effect in reasons else ABSENT


@dataclass(frozen=True)
class Outcome:
    """
    Expected and actual result of a target.

    `verdict` is that of a finding, `absent` or `untestable`. `half_width` (expected) and
    `found_half_width` are half the 95 % interval of the first coefficient; None without one.
    """

    target: Target
    chance: float
    verdict: str
    half_width: float | None
    found_half_width: float | None
    unit: str

    @property
    def resolved(self) -> bool:
        return self.verdict in RESOLVED

    @property
    def as_expected(self) -> bool:
        """Return whether the more probable of resolved and open occurred."""
        return self.resolved == (self.chance >= 0.5)

    def to_json(self) -> dict[str, Any]:
        """Return one object of `plan` of `diagnose --json`."""
        return {'effect': self.target.effect, 'joint': self.target.joint, 'chance': self.chance,
                'verdict': self.verdict, 'settled': self.resolved,
                'as_expected': self.as_expected, 'half_width': self.half_width,
                'found_half_width': self.found_half_width}


def read_expected(path: Path) -> list[dict[str, Any]]:
    """
    Return the `expected` objects of a file of `plan --json`.

    :raises BagError: if the file is not from that command.
    """
    try:
        document = json.loads(path.read_text(encoding='utf-8'))
        expected = document['expected']
        for one in expected:
            one['effect'], one['joint'], float(one['chance']), one['half_width'].items()
    except OSError as problem:
        raise BagError(f'{path}: {problem.strerror or problem}') from None
    except (ValueError, TypeError, KeyError, AttributeError):
        raise BagError(f'{path} is not what `plan --json` writes') from None
    return list(expected)


def outcomes(expected: list[dict[str, Any]], diagnosis: Diagnosis) -> list[Outcome]:
    """
    Return the outcome of each target.

    :raises BagError: if the diagnosis does not contain the joint of a target.
    """
    return [_outcome(one, diagnosis) for one in expected]


def _outcome(one: Mapping[str, Any], diagnosis: Diagnosis) -> Outcome:
    target = Target(one['effect'], one['joint'])
    if target.joint is not None and target.joint not in diagnosis.joints:
        raise BagError(f'the plan is for joint {target.joint}, which is not among '
                       f'{", ".join(diagnosis.joints)}')
    finding = finding_of(target, diagnosis)
    widths: Mapping[str, Mapping[str, Any]] = one['half_width']
    symbol = next(iter(widths), '')
    width = widths.get(symbol, {})
    estimate = finding.coefficients.get(symbol) if finding is not None else None
    return Outcome(target, float(one['chance']), outcome(target, diagnosis), width.get('value'),
                   None if estimate is None else 0.5 * (estimate.ci95[1] - estimate.ci95[0]),
                   str(width.get('unit', '')))


def summary(results: list[Outcome]) -> str:
    """Return the number of resolved targets, and the expected number."""
    resolved = sum(one.resolved for one in results)
    return (f'{resolved} of {len(results)} targets of the plan are resolved; expected by the '
            f'stated chances: {sum(one.chance for one in results):.1f}')
