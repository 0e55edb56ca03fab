"""A planned motion: its parts in words, and what to expect of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.planning.options import Target
import numpy as np


@dataclass(frozen=True)
class PlannedPart:
    """A part of the motion: from `start` to `end` in s the joints move as `what` says."""

    start: float
    end: float
    joints: tuple[str, ...]
    what: str
    settles: tuple[str, ...]

    @property
    def sentence(self) -> str:
        names = ' and '.join(filter(None, [', '.join(self.joints[:-1]), self.joints[-1]]))
        what = f' ({", ".join(self.settles)})' if self.settles else ''
        return f'{self.start:.1f} to {self.end:.1f} s: {names} {self.what}{what}'


@dataclass(frozen=True)
class Expectation:
    """
    What to expect of a target: chances that it is settled, before and after the motion.

    `half_width` is half the 95 % interval of each coefficient afterwards, by symbol, in its unit.
    `hardest` is the alternative that comes closest. `assumed` has the coefficients that the effect
    is taken to have; `measured` says that they come from the recordings. Separations are in
    standard errors from the best that the alternatives can do. `untestable` says why a diagnosis
    will not look for the effect after all, '' if it will.
    """

    target: Target
    chance_before: float
    chance: float
    half_width: dict[str, tuple[float, str]]
    hardest: str
    assumed: dict[str, float]
    measured: bool
    separation_before: float
    separation: float
    untestable: str

    @property
    def is_likely(self) -> bool:
        """Return whether the motion settles the target at least as likely as not."""
        return self.chance >= 0.5

    def to_json(self) -> dict[str, Any]:
        """Return one object of `expected` of `plan --json`."""
        widths = {symbol: {'value': width if np.isfinite(width) else None, 'unit': unit}
                  for symbol, (width, unit) in self.half_width.items()}
        return {'effect': self.target.effect, 'joint': self.target.joint,
                'chance_before': self.chance_before, 'chance': self.chance,
                'separation_before': self.separation_before, 'separation': self.separation,
                'untestable': self.untestable or None,
                'closest_alternative': self.hardest or None, 'assumed': self.assumed,
                'size_is_measured': self.measured, 'half_width': widths}


@dataclass(frozen=True)
class GravityExpectation:
    """
    How sure the gravity torque of a joint is, in N·m, over the poses of the recordings.

    Standard deviations as `GravityModel.predict_std` has them, before and after the motion.
    """

    joint: str
    before: float
    after: float

    @property
    def sentence(self) -> str:
        return (f'gravity torque of {self.joint}: unsure by ±{1.96 * self.before:.2g} N·m over '
                f'the recorded poses (95 %), by ±{1.96 * self.after:.2g} N·m after a fit to this '
                f'motion as well')


@dataclass(frozen=True)
class Plan:
    """
    A motion, its parts, and what to expect of it; `notes` are lines for the user.

    `gravity` has the joints whose gravity torque was unsure.
    """

    trajectory: Trajectory
    parts: tuple[PlannedPart, ...]
    expectations: tuple[Expectation, ...]
    notes: tuple[str, ...]
    gravity: tuple[GravityExpectation, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return what `plan --json` prints of the motion."""
        return {
            'duration_s': self.trajectory.duration, 'joints': list(self.trajectory.joints),
            'start': self.trajectory.q[0].tolist(),
            'parts': [{**asdict(part), 'sentence': part.sentence} for part in self.parts],
            'expected': [expected.to_json() for expected in self.expectations],
            'gravity': [asdict(each) for each in self.gravity],
            'notes': list(self.notes)}
