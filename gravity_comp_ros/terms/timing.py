"""Time delay between the torque and position signals."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.terms.effect import Coefficient, Effect, Setting, Sizes
from gravity_comp_ros.terms.motion import Motion
import numpy as np

# Minimum RMS rate of the gravity torque, in N·m/s.
_MIN_RATE = 0.02


class TimeDelay(Effect):
    """The column is -dg_n/dt in N·m/s, by the chain rule over all joints."""

    name = 'time_delay'
    coefficients = (Coefficient('T', 's', 'delay of torque relative to position'),)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return -np.einsum('mj,mj->m', motion.gradient[:, joint], motion.samples.qd)[:, None]

    def prior_std(self, sizes: Sizes) -> FloatArray:
        return np.array([0.02])

    def untestable(self, motion: Motion, joint: int) -> str | None:
        rate = float(np.sqrt(np.mean(self.columns(motion, joint, {}) ** 2)))
        if rate < _MIN_RATE:
            return f'the gravity torque changes too slowly on this joint ({rate:.2g} N·m/s)'
        return None


EFFECTS = (TimeDelay(),)
