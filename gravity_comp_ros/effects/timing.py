"""Torque and position that were not taken at the same instant."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Coefficient, Effect, Motion, Setting
from gravity_comp_ros.effects.plausibility import smaller_than
import numpy as np

# N·m/s: below this, half a second makes no difference that could be measured.
_LEAST_RATE = 0.02


def _delay(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    """Return -dg_n/dt (M, 1), N·m/s, by the chain rule over all joints."""
    return -np.einsum('mj,mj->m', motion.gradient[:, joint], motion.samples.qd)[:, None]


def _untestable(motion: Motion, joint: int) -> str | None:
    rate = float(np.sqrt(np.mean(_delay(motion, joint, {}) ** 2)))
    if rate < _LEAST_RATE:
        return f'gravity changes too slowly on this joint ({rate:.2g} N·m/s)'
    return None


EFFECTS = (
    Effect(
        name='time_delay',
        title='Torque that lags behind position',
        family='timing',
        equation='tau_n = -T sum_j dg_n/dq_j qd_j',
        description='A torque that is reported later than the position that belongs to it '
                    '(earlier, if negative); only what gravity does of it is seen here, while '
                    'friction late by as much looks like presliding.',
        coefficients=(Coefficient('T', 's', 'delay of torque against position'),),
        columns=_delay,
        pointwise=True,
        confounders=('viscous_friction', 'presliding_hysteresis'),
        experiment='move joint {joint} to and fro through the same way at two speeds with much '
                   'load and with none; a delay shows only with load',
        signature='speed',
        source='Yu 2022, Eq. (18) (slow motion against poses at rest); first-order expansion',
        untestable=_untestable,
        implausible=smaller_than(_delay, 0.5, 's', 'no bus takes that long; compare the clocks '
                                                   'of the two signals')),
)
