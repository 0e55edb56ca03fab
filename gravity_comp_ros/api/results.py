"""What a comparison and a diagnosis yield, for people: typed, and shown as tables."""

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
    Which effects a model is missing, the strongest first.

    `findings` say what, where, how sure (`Verdict`) and how much the held-out error falls;
    `joints` has the noise floor in N·m and the effective sample size of every joint; `found`
    are the findings that are established or likely. `raw` is the result of the core.
    """

    raw: core.Diagnosis

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Return all findings."""
        return self.raw.findings

    @property
    def found(self) -> tuple[Finding, ...]:
        """Return the findings that are established or likely."""
        return tuple(finding for finding in self.raw.findings if is_found(finding))

    @property
    def joints(self) -> Mapping[str, JointReport]:
        """Return noise floor, effective sample size and error of every joint."""
        return self.raw.joints

    def to_json(self) -> dict[str, Any]:
        """Return what `gravity_comp diagnose --json` prints of the diagnosis."""
        return {**self.raw.to_json(), 'verdict': self.summary()}

    def summary(self) -> str:
        """Return the whole answer in one sentence."""
        return wording.verdict(self.raw)

    def parts(self) -> Iterable[str | TextTable]:
        """Return the findings as a table, and why the first one is believed."""
        if not self.findings:
            return
        yield TextTable(
            ('joint', 'effect', 'verdict', 'coefficients, 95 %', 'held-out error', 'with it'),
            tuple((f.joint or 'whole arm', f.effect or '(none known)', f.verdict,
                   coefficients(f), *wording.before_and_after(f))
                  for f in self.findings), left=4)
        yield from (f'{f.effect or "unexplained"} on {wording.where(f)}: {f.why}'
                    for f in self.findings[:1] if f.why)


EXPECTED = ('to settle', 'chance now', 'chance then', 'coefficient, 95 %',
            'closest alternative')


@dataclass(frozen=True, eq=False, repr=False)
class MotionPlan(Displayable):
    """
    A motion that settles what recordings leave open, and what to expect of it.

    Obstacles and people are not known here; a note says whether the arm's own links were
    checked. `raw` is the result of the core.
    """

    raw: Plan

    @property
    def trajectory(self) -> Trajectory:
        """Return the motion: times in s, positions in rad, velocities and accelerations."""
        return self.raw.trajectory

    @property
    def expectations(self) -> tuple[Expectation, ...]:
        """Return the chance of each effect that it is settled, before and after the motion."""
        return self.raw.expectations

    def to_json(self) -> dict[str, Any]:
        """Return what `gravity_comp plan --json` prints of the motion."""
        return self.raw.to_json()

    def save(self, path: str | Path) -> None:
        """
        Write the motion as a ROS trajectory (.yaml) or a table (.csv).

        :raises BagError: if it cannot be written.
        """
        from gravity_comp_ros.recordings.trajectory_files import write_trajectory
        write_trajectory(Path(path), self.trajectory, [p.sentence for p in self.raw.parts])

    def summary(self) -> str:
        """Return one line: length of the motion, and how many parts it has."""
        return (f'a motion of {self.trajectory.duration:.1f} s in '
                f'{counted(len(self.raw.parts), "part")}')

    def parts(self) -> Iterable[str | TextTable]:
        """Return the parts, and what to expect."""
        yield from (part.sentence for part in self.raw.parts)
        yield TextTable(EXPECTED, tuple(map(expected_row, self.expectations)))
        yield from self.raw.notes


def expected_row(one: Expectation) -> tuple[str, ...]:
    """Return what to expect of one effect, in the columns `EXPECTED`."""
    widths = ', '.join(
        f'{symbol} ± {width:.2g} {unit}'.strip() if math.isfinite(width) else f'{symbol} unknown'
        for symbol, (width, unit) in one.half_width.items())
    return (one.target.name, f'{100 * one.chance_before:.0f} %', f'{100 * one.chance:.0f} %',
            widths, one.closest_alternative or '–')


def is_found(finding: Finding) -> bool:
    """Return whether a finding is sure enough to be added."""
    return finding.effect is not None and finding.verdict in wording.FOUND


def coefficients(finding: Finding, most: int = 3) -> str:
    """Return coefficients with units and 95 % intervals in one line, the first `most` of them."""
    items = list(finding.coefficients.items())
    shown = '; '.join(f'{symbol} = {wording.plus_minus(x)}' for symbol, x in items[:most])
    more = len(items) - most
    return shown + (f' and {more} more' if more > 0 else '') or '–'


def structure_lines(diagnosis: core.Diagnosis) -> list[str]:
    """Return what the torques do that no serial arm's gravity does, and what makes up for it."""
    return [f'{law.words}; ' + ('the effects above make up for it' if law.holds_with_effects else
                                f'not made up for; look for {", ".join(law.suspects)}')
            for law in diagnosis.laws]


def effect_numbers(effect: AppliedEffect, most: int = 6) -> list[str]:
    """Return the coefficients of an effect of a model, the first `most` of them."""
    parts = [f'{symbol} = {wording.plus_minus(Estimate(x.value, x.unit, x.ci95))}'
             for symbol, x in effect.coefficients.items()]
    return [*parts[:most], *([f'{len(parts) - most} more'] if len(parts) > most else ())]
