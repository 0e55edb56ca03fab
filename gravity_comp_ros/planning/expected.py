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

    The chances are the probabilities that an effect of the assumed size is found, and separated
    from every alternative. `gain` (after the motion) and the separations from the closest
    alternative are medians in nats of log evidence; `closest_alternative` may be ''. `half_width`
    is half the 95 % interval of each coefficient after the motion, by symbol, with its unit.
    `assumed` are estimates of the coefficients if `size_is_measured`, else the standard deviations
    of their prior. `untestable` gives the reason why the effect is not identified after the
    motion, '' if it is. `identified` is the share of the torque (RMS) of its best coefficient that
    all other columns leave.
    """

    target: Target
    chance_before: float
    chance: float
    half_width: dict[str, tuple[float, str]]
    closest_alternative: str
    assumed: dict[str, float]
    size_is_measured: bool
    gain: float
    separation_before: float
    separation: float
    untestable: str
    identified: float = 1.0

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
                'gain': self.gain, 'separation_before': self.separation_before,
                'separation': self.separation, 'identified': self.identified,
                'untestable': self.untestable or None,
                'closest_alternative': self.closest_alternative or None,
                'assumed': self.assumed, 'size_is_measured': self.size_is_measured,
                'half_width': widths}


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
