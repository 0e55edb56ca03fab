"""Torque and position that were not taken at the same instant."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Coefficient, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# N·m/s: below this, half a second makes no difference that could be measured.
_LEAST_RATE = 0.02


class TimeDelay(Effect):
    """The column is -dg_n/dt in N·m/s, by the chain rule over all joints."""

    name = 'time_delay'
    title = 'Torque that lags behind position'
    family = 'timing'
    equation = 'tau_n = -T sum_j dg_n/dq_j qd_j'
    description = ('A torque that is reported later than the position that belongs to it '
                   '(earlier, if negative); only what gravity does of it is seen here, while '
                   'friction late by as much looks like presliding.')
    coefficients = (Coefficient('T', 's', 'delay of torque against position'),)
    confounders = ('viscous_friction', 'presliding_hysteresis')
    experiment = ('move joint {joint} to and fro through the same way at two speeds with much '
                  'load and with none; a delay shows only with load')
    signature = 'speed'
    source = 'Yu 2022, Eq. (18) (slow motion against poses at rest); first-order expansion'
    pointwise = True
    needs_speed = True
    largest = 0.5
    why_not_larger = 'no bus takes that long; compare the clocks of the two signals'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return -np.einsum('mj,mj->m', motion.gradient[:, joint], motion.samples.qd)[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        rate = float(np.sqrt(np.mean(self.columns(motion, joint, {}) ** 2)))
        if rate < _LEAST_RATE:
            return f'gravity changes too slowly on this joint ({rate:.2g} N·m/s)'
        return None


EFFECTS = (TimeDelay(),)
