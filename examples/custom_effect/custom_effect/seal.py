"""
The drag of an oiled shaft seal, which grows with the root of the speed.

Copy this file, change the column and the words, and name the class in setup.py: `gravity_comp`
finds it from then on, next to its own.
"""

from gravity_comp_ros.effects.effect import Coefficient, Effect
from gravity_comp_ros.effects.excitation import insufficient_speeds
import numpy as np


class SealDrag(Effect):
    name = 'seal_drag'
    title = 'Drag of a shaft seal'
    family = 'friction'
    equation = 'tau_n = F_d tanh(qd_n / width) sqrt(|qd_n|)'
    description = 'Friction of an oiled seal, which grows with the root of the speed.'
    coefficients = (Coefficient('F_d', 'N·m·(s/rad)^0.5', 'drag at 1 rad/s'),)
    confounders = ('coulomb_friction', 'viscous_friction')
    experiment = ('move joint {joint} to and fro at five speeds, before and after changing the '
                  'seal')
    signature = 'speed'
    source = 'R. Flitney, Seals and Sealing Handbook, 6th ed., Butterworth-Heinemann, 2014'
    pointwise = True
    why_not_negative = 'a seal takes energy from the motion'

    def columns(self, motion, joint, setting):
        """Return the column (M, 1): sign(qd) sqrt(|qd|), smooth where the joint turns back."""
        speed = np.abs(motion.samples.qd[:, [joint]])
        return motion.direction(joint)[:, None] * np.sqrt(speed)

    def untestable(self, motion, joint):
        return insufficient_speeds(motion, joint)
