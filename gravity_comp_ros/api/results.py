"""Public results of `diagnose` and `plan`, displayed as tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.diagnosis import findings as core
from gravity_comp_ros.diagnosis import wording
from gravity_comp_ros.diagnosis.findings import Estimate, Finding, JointReport
from gravity_comp_ros.display import Displayable, TextTable
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.planning.plan import Expectation, Plan
from gravity_comp_ros.printable import counted


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Displayable):
    """
    Effects that a model does not include, the strongest first.

        for finding in diagnosis.found:
            print(finding.effect, finding.joint, finding.nrmse_before, finding.nrmse_after)

    - `findings`: all findings. Each has an effect, a joint, a `Verdict`, coefficients with 95 %
      intervals, and the held-out error without and with the effect.
    - `found`: the established and likely findings.
    - `joints`: noise floor in N·m, effective sample size and error of each joint.
    - `raw`: the result of the diagnosis core.
    """

    raw: core.Diagnosis

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Return all findings."""
        return self.raw.findings

    @property
    def found(self) -> tuple[Finding, ...]:
        """Return the established and likely findings."""
        return tuple(finding for finding in self.raw.findings if finding.is_missing)

    @property
    def joints(self) -> Mapping[str, JointReport]:
        """Return noise floor, effective sample size and error of each joint."""
        return self.raw.joints

    def to_json(self) -> dict[str, Any]:
        """Return the diagnosis part of `gravity_comp diagnose --json`."""
        return {**self.raw.to_json(), 'verdict': self.summary()}

    def summary(self) -> str:
        """Return the overall verdict in one sentence."""
        return wording.verdict(self.raw)

    def parts(self) -> Iterable[str | TextTable]:
        """Return a table of the findings, and the evidence for the first one."""
        if not self.findings:
            return
        yield TextTable(
            ('joint', 'effect', 'verdict', 'coefficients, 95 %', 'held-out error', 'with it'),
            tuple((f.joint or 'whole arm', f.effect or '(none known)', f.verdict,
                   coefficients(f), *wording.before_and_after(f))
                  for f in self.findings), left=4)
        yield from (f'{f.effect or "unexplained"} on {wording.where(f)}: {f.why}'
                    for f in self.findings[:1] if f.why)


EXPECTED = ('to resolve', 'chance now', 'chance then', 'coefficient, 95 %',
            'closest alternative')


@dataclass(frozen=True, eq=False, repr=False)
class MotionPlan(Displayable):
    """
    A motion that excites unresolved effects, with the expected precision of their coefficients.

        plan.save('motion.yaml')
        plan.expectations[0].chance      # probability that the effect is resolved

    Obstacles and people near the arm are not checked. A note reports whether self-collision was.
    `raw` is the result of the planner.
    """

    raw: Plan

    @property
    def trajectory(self) -> Trajectory:
        """Return the motion: t in s, q in rad, qd in rad/s, qdd in rad/s²."""
        return self.raw.trajectory

    @property
    def expectations(self) -> tuple[Expectation, ...]:
        """Return the probability that each effect is resolved, now and after the motion."""
        return self.raw.expectations

    def to_json(self) -> dict[str, Any]:
        """Return the motion part of `gravity_comp plan --json`."""
        return self.raw.to_json()

    def save(self, path: str | Path) -> None:
        """
        Write the motion as JointTrajectory (.yaml), table (.csv) or JointState bag (.mcap).

        :raises BagError: if the file cannot be written, or its ending is unknown.
        """
        from gravity_comp_ros.recordings.trajectory_files import write_trajectory
        write_trajectory(Path(path), self.trajectory, [p.sentence for p in self.raw.parts])

    def summary(self) -> str:
        """Return one line: duration of the motion and number of parts."""
        return (f'a motion of {self.trajectory.duration:.1f} s in '
                f'{counted(len(self.raw.parts), "part")}')

    def parts(self) -> Iterable[str | TextTable]:
        """Return the parts of the motion, a table of the expectations, and notes."""
        yield from (part.sentence for part in self.raw.parts)
        yield TextTable(EXPECTED, tuple(map(expected_row, self.expectations)))
        yield from self.raw.notes


def expected_row(one: Expectation) -> tuple[str, ...]:
    """Return the table row of one effect, in the columns `EXPECTED`."""
    widths = ', '.join(
        f'{symbol} ± {width:.2g} {unit}'.strip() if math.isfinite(width) else f'{symbol} unknown'
        for symbol, (width, unit) in one.half_width.items())
    return (one.target.name, f'{100 * one.chance_before:.0f} %', f'{100 * one.chance:.0f} %',
            widths, one.closest_alternative or '–')


def coefficients(finding: Finding, limit: int = 3) -> str:
    """Return the first `limit` coefficients with units and 95 % intervals, in one line."""
    items = list(finding.coefficients.items())
    values = '; '.join(f'{symbol} = {wording.plus_minus(x)}' for symbol, x in items[:limit])
    more = len(items) - limit
    return values + (f' and {more} more' if more > 0 else '') or '–'


def effect_numbers(effect: AppliedEffect, limit: int = 6) -> list[str]:
    """Return the first `limit` coefficients of an effect of a model, one text each."""
    parts = [f'{symbol} = {wording.plus_minus(Estimate(x.value, x.unit, x.ci95))}'
             for symbol, x in effect.coefficients.items()]
    return [*parts[:limit], *([f'{len(parts) - limit} more'] if len(parts) > limit else ())]
