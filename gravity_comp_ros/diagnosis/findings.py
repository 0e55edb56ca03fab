"""What a diagnosis says: findings, and a word on every joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from gravity_comp_ros.diagnosis.structure_tests import BrokenLaw


class Verdict(StrEnum):
    """How sure a finding is, the surest first; the last two say what cannot be judged."""

    ESTABLISHED = 'established'
    LIKELY = 'likely'
    AMBIGUOUS = 'ambiguous'
    WEAK = 'weak'
    UNTESTABLE = 'untestable'
    UNEXPLAINED = 'unexplained'


VERDICTS = tuple(Verdict)
# What is sure enough to be added.
FOUND = (Verdict.ESTABLISHED, Verdict.LIKELY)


@dataclass(frozen=True)
class Estimate:
    """A coefficient in its unit, with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Finding:
    """
    One effect, or something unexplained, on one joint (None: the whole arm).

    `nrmse_before` and `nrmse_after` are held-out fractions of the torque's range (Yu 2022,
    Eq. 16) without and with it; `base_absorbed` is the share of it that the gravity model
    imitates; `runs_better` the share of runs on which it helps. `next_step` is the motion that
    settles what is open, '' for what is to be added. `verdict` is a `Verdict`, which compares and
    prints as its text.
    """

    joint: str | None
    effect: str | None
    verdict: str
    rivals: tuple[str, ...]
    coefficients: Mapping[str, Estimate]
    nrmse_before: float
    nrmse_after: float
    base_absorbed: float
    runs_better: float
    why: str
    next_step: str
    p: float = 1.0
    setting: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'verdict', Verdict(self.verdict))

    def to_json(self) -> dict[str, Any]:
        """Return the finding as `diagnose --json` prints it."""
        return {
            'joint': self.joint, 'effect': self.effect, 'verdict': self.verdict,
            'rivals': list(self.rivals),
            'coefficients': {symbol: {'value': e.value, 'unit': e.unit, 'ci95': list(e.ci95)}
                             for symbol, e in self.coefficients.items()},
            'setting': dict(self.setting),
            'nrmse_before': self.nrmse_before, 'nrmse_after': self.nrmse_after,
            'base_absorbed': self.base_absorbed, 'runs_better': self.runs_better,
            'p': self.p, 'why': self.why, 'next_step': self.next_step}


@dataclass(frozen=True)
class JointReport:
    """
    A word on one joint: `noise_floor` in N·m, and how many samples count as independent.

    `rmse_before` and `rmse_after` are held-out errors in N·m without and with the findings.
    `remaining_share` is the remaining error as a share of the torque's range where it is far
    above the noise of the sensor, so that something is not explained; else 0.
    """

    summary: str
    noise_floor: float
    n_effective: float
    rmse_before: float
    rmse_after: float
    untestable: Mapping[str, str]
    remaining_share: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the report as `diagnose --json` prints it."""
        return {'summary': self.summary, 'noise_floor': self.noise_floor,
                'n_effective': self.n_effective, 'rmse_before': self.rmse_before,
                'rmse_after': self.rmse_after, 'remaining_share': self.remaining_share,
                'untestable': dict(self.untestable)}


@dataclass(frozen=True)
class Diagnosis:
    """
    All findings, the strongest first, the reports of all joints, and the laws that broke.

    `untestable` says of effects of the whole arm why this recording does not show them.
    """

    findings: tuple[Finding, ...]
    joints: Mapping[str, JointReport]
    untestable: Mapping[str, str] = field(default_factory=dict)
    laws: tuple[BrokenLaw, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return what `diagnose --json` prints."""
        return {'findings': [finding.to_json() for finding in self.findings],
                'joints': {name: report.to_json() for name, report in self.joints.items()},
                'untestable': dict(self.untestable),
                'structure': [law.to_json() for law in self.laws]}
