"""
Jobs and results of the fit process.

These types are the only dependency of the node's process on the fit process: it imports neither
SciPy nor the estimator.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gravity_comp_ros.export.gravity_code import Numbers
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.node import checks
from gravity_comp_ros.node.checks import Check
from gravity_comp_ros.node.epoch import Rows
from gravity_comp_ros.node.parameters import Parameters

# Kinds of jobs: fit a model and compare it with the one in use on held-out samples; find the
# effects that the model does not include; test whether the samples show another payload.
FIT, DIAGNOSIS, PAYLOAD = 'fit', 'diagnosis', 'payload test'
# Checks that fail where the effort is faulty.
FAULTS = (checks.NO_FACT, checks.GRAVITY_PRESENT, checks.JOINTS_AGREE, checks.BODY_EXPLAINS,
          checks.NO_FAULT, checks.WITHIN_LIMITS)


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

    `numbers` are those of the model for exported C source. `figures` has the errors of the
    comparison in one line. `outliers` has the number of samples of each joint that were left out.
    """

    model: GravityModel
    numbers: Numbers
    checks: tuple[Check, ...]
    figures: str
    how: str
    seconds: float
    outliers: Mapping[str, int] = field(default_factory=dict)

    @property
    def has_no_gravity(self) -> bool:
        """True if no joint's effort depends on pose, in enough motion."""
        return any(check.name == checks.POSE_EXPLAINS and not check.passed
                   for check in self.checks)

    @property
    def accepted(self) -> bool:
        return checks.failed(self.checks) is None

    @property
    def fault(self) -> str:
        """The reason for which the effort is faulty; empty if it is not."""
        return next((check.text for check in self.checks
                     if check.name in FAULTS and not check.passed), '')

    @property
    def reason(self) -> str:
        """The decision with its figures in one line."""
        refusal = checks.failed(self.checks)
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
        return bool(self.checks) and checks.failed(self.checks) is None


# The result of a diagnosis is a text.
Result = FitResult | PayloadResult | str
