"""Plausibility check of an effect: its torque must not exceed the measured torque."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Maximum torque of an effect, relative to the largest measured torque; larger torques cancel each
# other.
_MAX_RATIO = 1.5


def too_much_torque(torque: FloatArray, motion: Motion, joint: int) -> str | None:
    """Return the reason if a torque (M,) of the joint, or (M, N), exceeds the measured one."""
    measured = np.abs(motion.samples.tau)
    if torque.ndim == 1:
        measured = measured[:, joint]
    peak = float(np.abs(torque).max(initial=0.0))
    limit = float(measured.max(initial=0.0))
    if peak > _MAX_RATIO * limit:
        return f'its torque is up to {peak:.3g} N·m, the measured torque at most {limit:.3g} N·m'
    return None
