"""
Drag of an oiled shaft seal, which grows with the square root of the speed.

As a template: copy this file, change the column and the attributes, and name the class in
setup.py.
"""

from gravity_comp_ros.effects.effect import Coefficient
from gravity_comp_ros.effects.excitation import insufficient_speeds
from gravity_comp_ros.effects.friction import DirectionEffect
from gravity_comp_ros.effects.motion_direction import law_of
import numpy as np


class SealDrag(DirectionEffect):
    """Its setting is the law of the direction of friction, of which several are compared."""

    name = 'seal_drag'
    title = 'Drag of a shaft seal'
    family = 'friction'
    equation = 'tau_n = F_d d_n sqrt(|qd_n|)'
    description = 'Friction of an oiled seal, which grows with the square root of the speed.'
    coefficients = (Coefficient('F_d', 'N·m·(s/rad)^0.5', 'drag at 1 rad/s'),)
    confounders = ('coulomb_friction', 'viscous_friction')
    experiment = ('move joint {joint} back and forth at five speeds, before and after changing '
                  'the seal')
    signature = 'speed'
    source = 'R. Flitney, Seals and Sealing Handbook, 6th ed., Butterworth-Heinemann, 2014'
    uses_gravity = False  # so that its columns are computed once
    size = 0.05           # prior RMS of its torque, as a share of the joint's torque scale
    why_not_negative = 'a seal dissipates energy'

    def columns(self, motion, joint, setting):
        """Return the column (M, 1): the direction, from -1 to 1, times sqrt(|qd|)."""
        speed = np.abs(motion.samples.qd[:, [joint]])
        return motion.direction(joint, law_of(setting))[:, None] * np.sqrt(speed)

    def untestable(self, motion, joint):
        return insufficient_speeds(motion, joint)
