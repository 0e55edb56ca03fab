"""Periodic torque of gears, bearings and motors."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import (
    Coefficient, Coefficients, Effect, Needs, Setting)
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Range of periods per revolution: gravity has one, springs on cranks two or three.
_LOWEST = 4
_HIGHEST = 320
# Minimum travel in rad, and minimum number of periods within it: a torque with at most one
# extremum is that of a spring or cable. The evidence decides on others that do not repeat.
_MIN_TRAVEL = 0.1
_MIN_PERIODS = 0.5
# Maximum number of harmonics of a period.
_MAX_HARMONICS = 4


class TorqueRipple(Effect):
    """
    Integer values of k are compared, with the resolution that the travel allows.

    Gear teeth press unevenly: harmonics of k are added one by one.
    """

    name = 'torque_ripple'
    title = 'Torque ripple'
    family = 'periodic'
    equation = 'tau_n = sum_i (a_i sin(i k q_n) + b_i cos(i k q_n)), i = 1 to harmonics'
    description = ('Torque that repeats k times per revolution, caused by gear teeth, motor poles '
                   'or a misaligned shaft.')
    coefficients = (Coefficient('a', 'N·m', 'sine amplitude'),
                    Coefficient('b', 'N·m', 'cosine amplitude'))
    confounders = ('cable_stiffness', 'joint_spring', 'end_stop')
    experiment = ('move joint {joint} slowly over its whole range with the other joints at rest, '
                  'with at least ten samples per period')
    signature = 'position'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('P. S. Gandhi, F. H. Ghorbel, J. Dabney, Modeling, identification, and '
              'compensation of friction in harmonic drives, CDC 2002')
    setting_units = {'k': '1/rad', 'harmonics': ''}
    is_static = True
    size = 0.03

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        angles = np.outer(motion.samples.q[:, joint], setting['k'] * _orders(setting))
        return np.column_stack([np.sin(angles), np.cos(angles)])

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        orders = _orders(setting).astype(int)
        if len(orders) == 1:
            return self.coefficients
        return tuple(Coefficient(f'{symbol}_{order}', 'N·m', f'{wave} amplitude of harmonic '
                                 f'{order}') for symbol, wave in (('a', 'sine'), ('b', 'cosine'))
                     for order in orders)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        lowest, highest = _range(motion, joint)
        if highest < lowest:
            return []
        step = max(1, int(0.5 * np.pi / excitation.travel(motion, joint)))
        return [{'k': float(k), 'harmonics': 1.0} for k in range(lowest, highest + 1, step)]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        # Gear ratios need not be integers.
        width, lowest = np.pi / excitation.travel(motion, joint), _lowest(motion, joint)
        count = setting['harmonics']
        return [*({**setting, 'k': k} for part in (-0.5 * step, 0.5 * step)
                  if (k := setting['k'] + part * width / count) >= lowest),
                *({**setting, 'harmonics': other} for other in (count - 1.0, count + 1.0)
                  if 1.0 <= other <= _MAX_HARMONICS)]

    def prior_std(self, torque: float, columns: FloatArray) -> FloatArray:
        orders = np.arange(1, len(columns) // 2 + 1)
        return np.tile(self.size * torque / orders, 2)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        lowest, highest = _range(motion, joint)
        if highest < lowest:
            return (f'no period is identifiable over {excitation.travel(motion, joint):.2g} rad '
                    f'with this spacing of the samples')
        return None


def _orders(setting: Setting) -> FloatArray:
    return np.arange(1.0, setting['harmonics'] + 1.0)


def _range(motion: Motion, joint: int) -> tuple[int, int]:
    """
    Return the lowest and the highest identifiable k.

    The travel must include `_MIN_PERIODS`, and most samples must be less than half a period
    apart.
    """
    travel = excitation.travel(motion, joint)
    steps = np.abs(np.diff(motion.samples.q[:, joint]))[np.diff(motion.samples.runs) == 0]
    steps = steps[steps > 0]
    if travel < _MIN_TRAVEL or not steps.size:
        return _HIGHEST + 1, 0
    highest = int(np.pi / float(np.quantile(steps, 0.75)))
    return int(np.ceil(_lowest(motion, joint))), min(_HIGHEST, highest)


def _lowest(motion: Motion, joint: int) -> float:
    """Return the k with the minimum number of periods within the travel."""
    return max(float(_LOWEST), _MIN_PERIODS * 2 * np.pi / excitation.travel(motion, joint))


EFFECTS = (TorqueRipple(),)
