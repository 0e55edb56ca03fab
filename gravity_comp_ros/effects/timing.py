"""Time delay between the torque and position signals."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Coefficient, Effect, Needs, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Minimum RMS rate of the gravity torque, in N·m/s.
_MIN_RATE = 0.02


class TimeDelay(Effect):
    """The column is -dg_n/dt in N·m/s, by the chain rule over all joints."""

    name = 'time_delay'
    title = 'Time delay of the torque signal'
    family = 'timing'
    equation = 'tau_n = -T sum_j dg_n/dq_j qd_j'
    description = ('Torque signal that is later than the position signal (earlier, if negative). '
                   'Only the delay of gravity is modelled; delayed friction resembles presliding '
                   'hysteresis.')
    coefficients = (Coefficient('T', 's', 'delay of torque relative to position'),)
    confounders = ('viscous_friction', 'presliding_hysteresis')
    experiment = ('move joint {joint} back and forth over the same path at two speeds, with high '
                  'load and without load; a delay is identifiable with load only')
    signature = 'speed'
    needs = Needs.SPEED
    source = 'Yu 2022, Eq. (18) (slow motion against poses at rest); first-order expansion'
    largest = 0.5
    why_not_larger = 'no bus has such a delay; compare the clocks of the two signals'
    std = 0.02

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return -np.einsum('mj,mj->m', motion.gradient[:, joint], motion.samples.qd)[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        rate = float(np.sqrt(np.mean(self.columns(motion, joint, {}) ** 2)))
        if rate < _MIN_RATE:
            return f'the gravity torque changes too slowly on this joint ({rate:.2g} N·m/s)'
        return None


EFFECTS = (TimeDelay(),)
