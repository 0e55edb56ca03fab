"""
What is left over but repeats, whatever its shape.

Bumps along a joint's own angle, and along its angle by direction, can imitate any torque that
depends on them. If they predict held-out residuals, there is something to find; if no effect of
the library finds it, "none of these" is the answer, with the angle at which it is largest.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Regressor, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Coarse bumps find what is wide with little spent, fine ones a detent of a few degrees.
_RESOLUTIONS = (15, 60)
_BUMPS_BY_DIRECTION = 10
# A bump is held near 0 as though it had been seen to be 0 for this share of a block.
PRIOR_BLOCKS = 0.1


def bumps(q: FloatArray, low: float, high: float, count: int) -> FloatArray:
    """Return a row of Gaussians along q (M,), overlapping at half height, as (M, count)."""
    centres = np.linspace(low, high, count)
    width = 0.6 * (high - low) / max(count - 1, 1)
    return np.asarray(np.exp(-0.5 * ((q[:, None] - centres) / width) ** 2))


def largest_angle(q: FloatArray, coefficients: FloatArray, count: int) -> float:
    """Return the angle in rad at which the direction-free part is farthest from its median."""
    low, high = float(q.min()), float(q.max())
    grid = np.linspace(low, high, 400)
    shape = bumps(grid, low, high, count) @ coefficients[:count]
    return float(grid[np.argmax(np.abs(shape - np.median(shape)))])


class UnknownTorque(Regressor):
    """Any torque that depends on the joint angle and the direction of motion."""

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
