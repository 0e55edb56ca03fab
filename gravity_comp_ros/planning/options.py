"""Limits of a planned motion."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
import numpy as np

# Name of the target that is not an effect: the gravity torque where it is uncertain.
GRAVITY = 'gravity'
# Number of poses over which the standard deviation of gravity is taken.
POSES = 300


@dataclass(frozen=True)
class PlanOptions:
    """
    Limits of the planned motion.

    `duration` in s bounds the whole motion. `max_speed` (rad/s), `max_acceleration` (rad/s²) and
    `max_jerk` (rad/s³) apply to every joint. Positions stay within `low` and `high` (N,) in rad,
    by default the recorded range, and within `reach` rad of a recorded pose in every joint. The
    motion starts and ends at `start` (N,), by default a recorded pose near the middle. `rate` in
    Hz is that of the trajectory's points.

    :raises OptionError: if a limit is not positive, or the arrays are inconsistent.
    """

    duration: float = 20.0
    max_speed: float = 0.3
    max_acceleration: float = 1.0
    max_jerk: float = 10.0
    reach: float = 0.3
    rate: float = 50.0
    low: FloatArray | None = None
    high: FloatArray | None = None
    start: FloatArray | None = None

    def __post_init__(self) -> None:
        check_positive(self, 'plan', 'duration', 'max_speed', 'max_acceleration', 'max_jerk',
                       'rate')
        if not self.reach > 0.0:
            raise OptionError(f'plan: reach is {self.reach}; it must be positive')
        if (self.low is None) != (self.high is None):
            raise OptionError('plan: give both low and high, or neither')
        if self.low is not None and self.high is not None and (
                self.low.shape != self.high.shape or (self.low > self.high).any()):
            raise OptionError('plan: low must not exceed high')
        if self.start is not None and not np.isfinite(self.start).all():
            raise OptionError('plan: the start pose is not finite')
