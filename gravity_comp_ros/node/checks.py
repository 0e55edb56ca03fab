"""
Checks of a decision, and the jobs and results of the fit process.

These types are the only dependency of the node's process on the fit process: it imports neither
SciPy nor the estimator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import json
import math

from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node.epoch import Rows
from gravity_comp_ros.node.parameters import Parameters

# Names of the checks, as on `~/checks`; docs/node.md explains each.
BETTER, NO_JOINT_WORSE = 'better on held-out samples', 'no joint worse'
POSE_EXPLAINS, GRAVITY_PRESENT = 'pose explains the effort', 'gravity is present'
NOT_OUTPUT, CONVERGED = 'not the output of the node', 'converged'
JOINTS_AGREE, BODY_EXPLAINS = 'joints agree', 'a body explains the change'
NO_FAULT, WITHIN_LIMITS = 'no fault explains it better', 'within the payload limits'
BODY_PRESENT = 'a body is present'
NO_PUSH, NOT_VARYING = 'no push in another direction', 'no varying force'
NO_FACT = 'no fact against the samples'
PREDICTS, BETTER_THAN_PREVIOUS = 'predicts new samples', 'better than the previous model'
# Checks that fail where the effort is faulty.
FAULTS = (NO_FACT, GRAVITY_PRESENT, JOINTS_AGREE, BODY_EXPLAINS, NO_FAULT, WITHIN_LIMITS)
# Kinds of jobs: fit a model and compare it with the one in use on held-out samples; find the
# effects that the model does not include; test whether the samples show another payload.
FIT, DIAGNOSIS, PAYLOAD = 'fit', 'diagnosis', 'payload test'
# Levels of a status.
OK, WARN, ERROR, STALE = range(4)


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


@dataclass(frozen=True)
class Job:
    """
    The input of one job.

    - `kind`: one of the kinds above.
    - `rows`: the samples.
    - `model`: the model in use now; `base` that when the epoch began, whose change may be fitted.
    - `settings`: formulation and effects of a full fit, limits of a payload, accepted facts.
    - `geometry`: the axes where they are known.
    - `on_request`: whether a service call requested the job.
    """

    kind: str
    rows: Rows
    model: GravityModel | None = None
    base: GravityModel | None = None
    settings: Parameters = Parameters()
    geometry: Geometry | None = None
    on_request: bool = False


@dataclass(frozen=True, eq=False)
class FitResult:
    """
    The best model of a job, its checks, and the computing time in s.

    `figures` has the errors of the comparison in one line. `outliers` has the number of samples of
    each joint that were left out.
    """

    model: GravityModel
    checks: tuple[Check, ...]
    figures: str
    how: str
    seconds: float
    outliers: Mapping[str, int] = field(default_factory=dict)

    @property
    def has_no_gravity(self) -> bool:
        """True if no joint's effort depends on pose, in enough motion."""
        return any(check.name == POSE_EXPLAINS and not check.passed
                   for check in self.checks)

    @property
    def accepted(self) -> bool:
        return failed(self.checks) is None

    @property
    def fault(self) -> str:
        """The reason for which the effort is faulty; empty if it is not."""
        return next((check.text for check in self.checks
                     if check.name in FAULTS and not check.passed), '')

    @property
    def reason(self) -> str:
        """The decision with its figures in one line."""
        refusal = failed(self.checks)
        return self.figures if refusal is None else f'{refusal.text} ({self.figures})'


@dataclass(frozen=True)
class PayloadResult:
    """
    The result of a payload test.

    `text` is a sentence, `values` are named figures. `is_other` is true if the effort has changed
    in a way that no payload explains.
    """

    text: str
    checks: tuple[Check, ...] = ()
    values: Mapping[str, str] = field(default_factory=dict)
    is_other: bool = False

    @property
    def is_payload(self) -> bool:
        """True if a body on the last link explains the window: every check passed."""
        return bool(self.checks) and failed(self.checks) is None


# The result of a diagnosis is a text.
Result = FitResult | PayloadResult | str
