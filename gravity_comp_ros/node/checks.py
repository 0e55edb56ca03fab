"""Checks of a decision: what was tested, its statistic, its limit, and whether it passed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import json
import math

# Names of the checks, as on `~/checks`; docs/node.md explains each.
BETTER, NO_JOINT_WORSE = 'better on held-out samples', 'no joint worse'
POSE_EXPLAINS, GRAVITY_PRESENT = 'pose explains the effort', 'gravity is present'
NOT_OUTPUT, CONVERGED = 'not the output of the node', 'converged'
JOINTS_AGREE, BODY_EXPLAINS = 'joints agree', 'a body explains the change'
NO_FAULT, WITHIN_LIMITS = 'no fault explains it better', 'within the payload limits'
BODY_PRESENT, IN_EACH_PART = 'a body is present', 'in each part of the window'
NO_PUSH, NOT_VARYING = 'no push in another direction', 'no varying force'
NO_FACT = 'no fact against the samples'
LASTS = 'lasts long enough'
PREDICTS, BETTER_THAN_PREVIOUS = 'predicts new samples', 'better than the previous model'


@dataclass(frozen=True)
class Check:
    """
    One check: its name, the statistic, the limit, and whether it passed; `text` names the reason.

    A statistic passes if it is at most the limit, or at least the limit with `is_minimum`.
    """

    name: str
    statistic: float
    limit: float
    is_minimum: bool = False
    text: str = ''

    @property
    def passed(self) -> bool:
        if self.is_minimum:
            return bool(self.statistic >= self.limit)
        return bool(self.statistic <= self.limit)

    def describe(self) -> str:
        """Return the check with its figures as text."""
        sign = '≥' if self.is_minimum else '≤'
        figures = f'{self.name}: {self.statistic:.3g} {sign} {self.limit:.3g}'
        return figures if self.passed else f'not {figures}'


def failed(checks: Sequence[Check]) -> Check | None:
    """Return the first check that did not pass, None if all passed."""
    return next((check for check in checks if not check.passed), None)


def summary(checks: Sequence[Check]) -> str:
    """Return all checks with their figures in one line."""
    return '; '.join(check.describe() for check in checks)


def to_json(decision: str, result: str, checks: Sequence[Check]) -> str:
    """
    Return the checks of a decision as JSON, for `~/checks`.

    :param decision: what was decided, such as `model`.
    :param result: the decision in one sentence.
    """
    return json.dumps({'decision': decision, 'result': result, 'checks': [
        {'check': check.name, 'statistic': _number(check.statistic), 'limit': _number(check.limit),
         'passed_if': 'at least' if check.is_minimum else 'at most', 'passed': check.passed,
         'text': check.text} for check in checks]}, ensure_ascii=False)


def _number(value: float) -> float | None:
    return float(f'{value:.4g}') if math.isfinite(value) else None
