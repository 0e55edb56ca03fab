"""What became of a plan: which targets a later diagnosis settles, as expected or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from gravity_comp_ros.diagnosis.findings import Diagnosis, Finding, FOUND
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.planning.options import Target

# No finding, though the recordings could show the effect.
ABSENT = 'absent'
UNTESTABLE = 'untestable'
SETTLED = (*map(str, FOUND), ABSENT)


def finding_of(target: Target, diagnosis: Diagnosis | None) -> Finding | None:
    """Return what was found of a target, if anything."""
    return next((f for f in (diagnosis.findings if diagnosis else ())
                 if (f.effect, f.joint) == (target.effect, target.joint)), None)


def outcome(target: Target, diagnosis: Diagnosis) -> str:
    """Return the verdict on a target, `absent` or `untestable`."""
    finding = finding_of(target, diagnosis)
    if finding is not None:
        return str(finding.verdict)
    if target.joint is None:
        reasons = diagnosis.untestable
    else:
        reasons = diagnosis.joints[target.joint].untestable
    return UNTESTABLE if target.effect in reasons else ABSENT


@dataclass(frozen=True)
class Outcome:
    """
    What was expected of a target, and what a diagnosis says of it now.

    `verdict` is one of a finding, `absent` or `untestable`. `half_width` and `found_half_width`
    are of the 95 % interval of the first coefficient; None where there is none.
    """

    target: Target
    chance: float
    verdict: str
    half_width: float | None
    found_half_width: float | None
    unit: str

    @property
    def settled(self) -> bool:
        return self.verdict in SETTLED

    @property
    def as_expected(self) -> bool:
        """Return whether the likelier of settled and open is what came."""
        return self.settled == (self.chance >= 0.5)

    def to_json(self) -> dict[str, Any]:
        """Return one object of `plan` of `diagnose --json`."""
        return {'effect': self.target.effect, 'joint': self.target.joint, 'chance': self.chance,
                'verdict': self.verdict, 'settled': self.settled,
                'as_expected': self.as_expected, 'half_width': self.half_width,
                'found_half_width': self.found_half_width}


def read_expected(path: Path) -> list[dict[str, Any]]:
    """
    Return what `plan --json` expected.

    :raises BagError: if the file is none of that command.
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
    Return what became of each target.

    :raises BagError: if a target is on a joint that the diagnosis does not have.
    """
    return [_outcome(one, diagnosis) for one in expected]


def _outcome(one: Mapping[str, Any], diagnosis: Diagnosis) -> Outcome:
    target = Target(one['effect'], one['joint'])
    if target.joint is not None and target.joint not in diagnosis.joints:
        raise BagError(f'the plan was for joint {target.joint}, which is none of '
                       f'{", ".join(diagnosis.joints)}')
    finding = finding_of(target, diagnosis)
    widths: Mapping[str, Mapping[str, Any]] = one['half_width']
    symbol = next(iter(widths), '')
    width = widths.get(symbol, {})
    found = finding.coefficients.get(symbol) if finding is not None else None
    return Outcome(target, float(one['chance']), outcome(target, diagnosis), width.get('value'),
                   None if found is None else 0.5 * (found.ci95[1] - found.ci95[0]),
                   str(width.get('unit', '')))


def summary(found: list[Outcome]) -> str:
    """Return how many targets are settled, and how many were to be."""
    settled = sum(one.settled for one in found)
    return (f'{settled} of {len(found)} planned for are settled; the stated chances add up to '
            f'{sum(one.chance for one in found):.1f}')
