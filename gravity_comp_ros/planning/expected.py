"""Planned motion, descriptions of its parts, and the expected result of each target."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.planning.options import Target
import numpy as np


@dataclass(frozen=True)
class PlannedPart:
    """A part of the motion from `start` to `end` in s; `what` describes it."""

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
    Expected result of a target, before and after the motion.

    The chances are the power of a diagnosis. Separations from the closest fit of the alternatives
    are in standard errors; `closest_alternative` may be ''. `half_width` is half the 95 % interval
    of each coefficient after the motion, by symbol, with its unit. `assumed` are the coefficients
    of the effect, estimates from the recordings if `size_is_measured`. `untestable` gives the
    reason why a diagnosis will not test the effect, '' if it will. A rare effect must remove a
    minimum share of the error: `required_separation`, 0 for other effects. `unabsorbed` is the
    share of its torque outside the gravity terms.
    """

    target: Target
    chance_before: float
    chance: float
    half_width: dict[str, tuple[float, str]]
    closest_alternative: str
    assumed: dict[str, float]
    size_is_measured: bool
    separation_before: float
    separation: float
    untestable: str
    required_separation: float = 0.0
    unabsorbed: float = 1.0

    @property
    def is_likely(self) -> bool:
        """Return whether the motion resolves the target with a chance of at least one half."""
        return self.chance >= 0.5

    def to_json(self) -> dict[str, Any]:
        """Return one object of `expected` of `plan --json`."""
        widths = {symbol: {'value': width if np.isfinite(width) else None, 'unit': unit}
                  for symbol, (width, unit) in self.half_width.items()}
        return {'effect': self.target.effect, 'joint': self.target.joint,
                'chance_before': self.chance_before, 'chance': self.chance,
                'separation_before': self.separation_before, 'separation': self.separation,
                'required_separation': self.required_separation, 'unabsorbed': self.unabsorbed,
                'untestable': self.untestable or None,
                'closest_alternative': self.closest_alternative or None,
                'assumed': self.assumed, 'size_is_measured': self.size_is_measured,
                'half_width': widths}


@dataclass(frozen=True)
class GravityExpectation:
    """
    Standard deviation of a joint's gravity torque over the recorded poses, N·m.

    It is that of `GravityModel.predict_std`, before and after a fit to the motion.
    """

    joint: str
    before: float
    after: float

    @property
    def sentence(self) -> str:
        return (f'gravity torque of {self.joint} over the recorded poses: uncertain by '
                f'±{1.96 * self.before:.2g} N·m (95 %), by ±{1.96 * self.after:.2g} N·m after a '
                f'fit that includes this motion')


@dataclass(frozen=True)
class Plan:
    """
    A motion, its parts and its expected results; `notes` are messages to the user.

    `gravity` has the joints whose gravity torque is uncertain.
    """

    trajectory: Trajectory
    parts: tuple[PlannedPart, ...]
    expectations: tuple[Expectation, ...]
    notes: tuple[str, ...]
    gravity: tuple[GravityExpectation, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the object of `plan --json`."""
        return {
            'duration_s': self.trajectory.duration, 'joints': list(self.trajectory.joints),
            'start': self.trajectory.q[0].tolist(),
            'parts': [{**asdict(part), 'sentence': part.sentence} for part in self.parts],
            'expected': [expected.to_json() for expected in self.expectations],
            'gravity': [asdict(each) for each in self.gravity],
            'notes': list(self.notes)}
