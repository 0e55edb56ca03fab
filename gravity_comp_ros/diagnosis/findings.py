"""Results of a diagnosis: findings, verdicts, and a report of every joint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.display import Displayable, TextTable
from gravity_comp_ros.models.applied_effects import Quantity


class Verdict(StrEnum):
    """Confidence in a finding, the highest first; the last two name no single effect."""

    ESTABLISHED = 'established'
    LIKELY = 'likely'
    AMBIGUOUS = 'ambiguous'
    WEAK = 'weak'
    UNTESTABLE = 'untestable'
    UNEXPLAINED = 'unexplained'


# Verdicts of effects that can be added to the model.
FOUND = (Verdict.ESTABLISHED, Verdict.LIKELY)


@dataclass(frozen=True)
class Finding:
    """
    One effect, or an unexplained residual, on one joint (None: the whole arm).

    `nrmse_before` and `nrmse_after` are held-out errors without and with it, as fractions of the
    torque range (Yu 2022, Eq. 16). `base_absorbed` is the share of its torque (RMS) that gravity
    and all other terms absorb, `runs_better` the share of runs that it improves, `gain` its log
    evidence in nats. `rivals` are alternative explanations. `to_add` are
    the targets to add: the effect, and the testable alternatives of an ambiguous one, of which the
    sum is identified. `next_step` is the motion that resolves an open finding, '' for one that is
    established or likely. `verdict` is a `Verdict`, which compares and prints as its text.
    `is_predicted` is true if the model predicts it already, together with gravity, from which this
    motion hardly separates it.

    Of an unexplained residual `nrmse_before` is the held-out error with all effects;
    `nrmse_after` is that error without the part of the fitted residual that repeats with the
    angle, which is not held out, and `runs_better` is always 1.
    """

    joint: str | None
    effect: str | None
    verdict: str
    rivals: tuple[str, ...]
    coefficients: Mapping[str, Quantity]
    nrmse_before: float
    nrmse_after: float
    base_absorbed: float
    runs_better: float
    why: str
    next_step: str
    gain: float = 0.0
    p: float = 1.0
    setting: Mapping[str, float] = field(default_factory=dict)
    is_predicted: bool = False
    to_add: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, 'verdict', Verdict(self.verdict))

    @property
    def is_missing(self) -> bool:
        """Return whether it is an effect, established or likely, that the model can be given."""
        return self.effect is not None and self.verdict in FOUND and not self.is_predicted

    def to_json(self) -> dict[str, Any]:
        """Return the finding as `diagnose --json` prints it."""
        document = asdict(self)
        document['predicted'] = document.pop('is_predicted')
        return document


@dataclass(frozen=True)
class JointReport:
    """
    Report of one joint: `noise_floor` in N·m and effective sample size `n_effective`.

    `rmse_before` and `rmse_after` are held-out errors in N·m without and with the effects to add.
    `remaining_share` is the error that remains with all effects, as a share of the torque range,
    if it is far above the sensor noise, else 0. `untestable` maps effects to the reason why they
    cannot be tested.
    """

    summary: str
    noise_floor: float
    n_effective: float
    rmse_before: float
    rmse_after: float
    untestable: Mapping[str, str]
    remaining_share: float = 0.0


@dataclass(frozen=True, repr=False)
class Diagnosis(Displayable):
    """
    Effects that a model does not include, the strongest first, and the reports of all joints.

        for finding in diagnosis.found:
            print(finding.effect, finding.joint, finding.nrmse_before, finding.nrmse_after)

    `findings` are all findings. `untestable` maps effects of the whole arm to the reason why they
    cannot be tested.
    """

    findings: tuple[Finding, ...]
    joints: Mapping[str, JointReport]
    untestable: Mapping[str, str] = field(default_factory=dict)

    @property
    def found(self) -> tuple[Finding, ...]:
        """Return the established and likely findings."""
        return tuple(finding for finding in self.findings if finding.is_missing)

    @property
    def to_add(self) -> tuple[str, ...]:
        """Return the targets of all findings to add."""
        return tuple(dict.fromkeys(name for f in self.findings for name in f.to_add))

    def finding(self, effect: str, joint: str | None) -> Finding | None:
        """Return the finding on an effect of a joint (None: of the whole arm), None without it."""
        return next((f for f in self.findings if (f.effect, f.joint) == (effect, joint)), None)

    def to_json(self) -> dict[str, Any]:
        """Return the diagnosis part of `diagnose --json`."""
        return {'findings': [finding.to_json() for finding in self.findings],
                'joints': {name: asdict(report) for name, report in self.joints.items()},
                'untestable': dict(self.untestable), 'verdict': self.summary()}

    def summary(self) -> str:
        """Return the overall verdict in one sentence."""
        return wording.verdict(self)

    def table(self) -> TextTable:
        """Return the findings with their size, and held-out error without and with each."""
        return TextTable(
            ('joint', 'effect', 'verdict', 'coefficients, 95 %', 'held-out error'),
            tuple((f.joint or 'whole arm', f.effect or '(none known)', f.verdict,
                   wording.coefficients(f.coefficients), wording.change(f))
                  for f in self.findings))

    def details(self) -> Iterable[str | TextTable]:
        """Return a table of the findings, and the evidence for the first one."""
        if self.findings:
            yield self.table()
        yield from (f'{f.effect or "unexplained"} on {wording.where(f)}: {f.why}'
                    for f in self.findings[:1] if f.why)
