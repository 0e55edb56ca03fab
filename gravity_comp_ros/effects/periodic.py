"""What repeats along a joint's turn: gears, bearings and motors that are not even."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation as facts
from gravity_comp_ros.effects.effect import Coefficient, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Gravity itself goes once a turn, and springs on cranks two or three times.
_LOWEST = 4
_HIGHEST = 320
_LEAST_TRAVEL = 0.1
# Periods in the travel: one is any smooth torque, and only what comes again repeats.
_LEAST_PERIODS = 2.0


class TorqueRipple(Effect):
    """The setting k is a whole number at first: as far apart as the travel tells neighbours."""

    name = 'torque_ripple'
    title = 'Torque ripple'
    family = 'periodic'
    equation = 'tau_n = a sin(k q_n) + b cos(k q_n)'
    description = ('A torque that repeats k times a turn: teeth of a gear, poles of a motor, a '
                   'shaft out of true.')
    coefficients = (Coefficient('a', 'N·m', 'sine part'), Coefficient('b', 'N·m', 'cosine part'))
    confounders = ('cable_stiffness', 'joint_spring', 'end_stop')
    experiment = ('move joint {joint} slowly through its whole range with the others still, '
                  'at a speed that leaves ten samples for each period')
    signature = 'position'
    source = ('P. S. Gandhi, F. H. Ghorbel, J. Dabney, Modeling, identification, and '
              'compensation of friction in harmonic drives, CDC 2002')
    setting_units = {'k': '1/rad'}
    pointwise = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        angle = setting['k'] * motion.samples.q[:, joint]
        return np.column_stack([np.sin(angle), np.cos(angle)])

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        lowest, highest = _range(motion, joint)
        if highest < lowest:
            return []
        step = max(1, int(0.5 * np.pi / facts.travel(motion, joint)))
        return [{'k': float(k)} for k in range(lowest, highest + 1, step)]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        # The ratio of a gear need not be a whole number.
        width, lowest = np.pi / facts.travel(motion, joint), _lowest(motion, joint)
        return [{'k': k} for part in (-0.5, -0.25, 0.25, 0.5)
                if (k := setting['k'] + part * width) >= lowest]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        lowest, highest = _range(motion, joint)
        if highest < lowest:
            return (f'with {facts.travel(motion, joint):.2g} rad of travel and samples this far '
                    f'apart no period can be told')
        return None


def _range(motion: Motion, joint: int) -> tuple[int, int]:
    """
    Return the lowest and the highest k that the motion can tell.

    Two periods must fit into the travel, and most samples must be less than half a period apart.
    """
    travel = facts.travel(motion, joint)
    steps = np.abs(np.diff(motion.samples.q[:, joint]))[np.diff(motion.samples.runs) == 0]
    steps = steps[steps > 0]
    if travel < _LEAST_TRAVEL or not steps.size:
        return _HIGHEST + 1, 0
    highest = int(np.pi / float(np.quantile(steps, 0.75)))
    return int(np.ceil(_lowest(motion, joint))), min(_HIGHEST, highest)


def _lowest(motion: Motion, joint: int) -> float:
    """Return the k of as many periods as a ripple must have to be one."""
    return max(float(_LOWEST), _LEAST_PERIODS * 2 * np.pi / facts.travel(motion, joint))


EFFECTS = (TorqueRipple(),)
