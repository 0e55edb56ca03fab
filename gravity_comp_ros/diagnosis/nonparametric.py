"""
Nonparametric test for a residual that repeats with joint angle and direction of motion.

Gaussian basis functions of a joint's angle, with and without its direction of motion, approximate
any torque that depends on both. If they reduce the held-out error and no effect of the library
does, the residual is reported as unexplained, with the angle at which it is largest.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Regressor, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Numbers of basis functions: few for wide shapes, many for a detent of a few degrees.
_RESOLUTIONS = (15, 60)
_BUMPS_BY_DIRECTION = 10
# Weight of the zero-mean prior of a coefficient, as a number of blocks.
PRIOR_BLOCKS = 0.1


def bumps(q: FloatArray, low: float, high: float, count: int) -> FloatArray:
    """Return evenly spaced Gaussian basis functions at q (M,), as (M, count)."""
    centres = np.linspace(low, high, count)
    width = 0.6 * (high - low) / max(count - 1, 1)
    return np.asarray(np.exp(-0.5 * ((q[:, None] - centres) / width) ** 2))


def largest_angle(q: FloatArray, coefficients: FloatArray, count: int) -> float:
    """Return the angle in rad of the largest deviation from the median, direction ignored."""
    low, high = float(q.min()), float(q.max())
    grid = np.linspace(low, high, 400)
    shape = bumps(grid, low, high, count) @ coefficients[:count]
    return float(grid[np.argmax(np.abs(shape - np.median(shape)))])


class UnknownTorque(Regressor):
    """Any torque that depends on the angle and the direction of motion of its joint."""

    name = 'unknown'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        q = motion.samples.q[:, joint]
        low, high = float(q.min()), float(q.max())
        return np.column_stack([
            bumps(q, low, high, int(setting['bumps'])),
            bumps(q, low, high, _BUMPS_BY_DIRECTION) * motion.direction(joint)[:, None]])

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return [{'bumps': float(count)} for count in _RESOLUTIONS]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return 'the joint hardly moves' if np.ptp(motion.samples.q[:, joint]) < 0.05 else None
