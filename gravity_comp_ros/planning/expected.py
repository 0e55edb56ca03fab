"""Planned motion, its parts, and the expected result of each target."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.display import Displayable, TextTable
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.printable import counted
import numpy as np

# Columns of `Expectation.row`.
EXPECTED = ('to resolve', 'chance now', 'chance then', 'coefficient, 95 %',
            'closest alternative')


@dataclass(frozen=True)
class PlannedPart:
    """A part of the motion from `start` to `end` in s; `what` describes it."""

    start: float
    end: float
    joints: tuple[str, ...]
    what: str

    @property
    def sentence(self) -> str:
        names = ' and '.join(filter(None, [', '.join(self.joints[:-1]), self.joints[-1]]))
        return f'{self.start:.1f} to {self.end:.1f} s: {names} {self.what}'


@dataclass(frozen=True)
class Expectation:
    """
    Expected result of an effect on a joint (None: the whole arm), before and after the motion.

    The chances are the probabilities that an effect of the assumed size is found, and separated
    from every alternative; `closest_alternative` may be ''. `half_width` is half the 95 %
    interval of each coefficient after the motion, by symbol, with its unit.
    `assumed` are estimates of the coefficients if `size_is_measured`, else the standard deviations
    of their prior. `untestable` gives the reason why the effect is not identified after the
    motion, '' if it is. `identified` is the share of the torque (RMS) of its best coefficient that
    all other columns leave.
    """

    effect: str
    joint: str | None
    chance_before: float
    chance: float
    half_width: dict[str, tuple[float, str]]
    closest_alternative: str
    assumed: dict[str, float]
    size_is_measured: bool
    untestable: str
    identified: float = 1.0

    @property
    def target(self) -> str:
        """Return the target as `NAME:JOINT`, or `NAME` for the whole arm."""
        return target(self.effect, self.joint)

    @property
    def is_likely(self) -> bool:
        """Return whether the motion resolves the target with a chance of at least one half."""
        return self.chance >= 0.5

    def row(self) -> tuple[str, ...]:
        """Return the cells of the columns `EXPECTED`."""
        widths = ', '.join(
            f'{symbol} ± {width:.2g} {unit}'.strip() if np.isfinite(width) else f'{symbol} unknown'
            for symbol, (width, unit) in self.half_width.items())
        return (self.target, f'{100 * self.chance_before:.0f} %',
                f'{100 * self.chance:.0f} %', widths, self.closest_alternative or '–')

    def to_json(self) -> dict[str, Any]:
        """Return one object of `expected` of `plan --json`."""
        widths = {symbol: {'value': width if np.isfinite(width) else None, 'unit': unit}
                  for symbol, (width, unit) in self.half_width.items()}
        return {**vars(self), 'untestable': self.untestable or None,
                'closest_alternative': self.closest_alternative or None, 'half_width': widths}


@dataclass(frozen=True)
class GravityExpectation:
    """
    Standard deviation of a joint's gravity torque over the recorded poses, N·m.

    It is the root mean square, before and after a fit that includes the motion.
    """

    joint: str
    before: float
    after: float

    @property
    def sentence(self) -> str:
        return (f'gravity torque of {self.joint} over the recorded poses: uncertain by '
                f'±{HALF_95 * self.before:.2g} N·m (95 %), by ±{HALF_95 * self.after:.2g} N·m '
                f'after a fit that includes this motion')


@dataclass(frozen=True, repr=False)
class MotionPlan(Displayable):
    """
    A motion that excites unresolved effects, its parts, and the expected results.

        plan.save('motion.yaml')
        plan.expectations[0].chance      # probability that the effect is resolved

    `gravity` has the joints whose gravity torque is uncertain. `notes` are messages to the user.
    Obstacles and people near the arm are not checked.
    """

    trajectory: Trajectory
    parts: tuple[PlannedPart, ...]
    expectations: tuple[Expectation, ...]
    notes: tuple[str, ...]
    gravity: tuple[GravityExpectation, ...] = ()

    def save(self, path: str | Path) -> None:
        """
        Write the motion as JointTrajectory (.yaml) or JointState bag (.mcap).

        :raises BagError: if the file cannot be written, or its ending is unknown.
        """
        from gravity_comp_ros.planning.trajectory_files import write_trajectory
        write_trajectory(Path(path), self.trajectory, [part.sentence for part in self.parts])

    def summary(self) -> str:
        """Return one line: duration of the motion and number of parts."""
        return (f'a motion of {self.trajectory.duration:.1f} s in '
                f'{counted(len(self.parts), "part")}')

    def details(self) -> Iterable[str | TextTable]:
        """Return the parts of the motion, a table of the expectations, and notes."""
        yield from (part.sentence for part in self.parts)
        yield TextTable(EXPECTED, tuple(each.row() for each in self.expectations))
        yield from self.notes

    def to_json(self) -> dict[str, Any]:
        """Return the object of `plan --json`."""
        return {
            'duration_s': self.trajectory.duration, 'joints': self.trajectory.joints,
            'start': self.trajectory.q[0].tolist(),
            'parts': [{**vars(part), 'sentence': part.sentence} for part in self.parts],
            'expected': [expected.to_json() for expected in self.expectations],
            'gravity': self.gravity,
            'notes': self.notes}
