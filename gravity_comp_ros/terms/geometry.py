"""
Geometric errors that begin during a recording: encoder offsets and base tilt.

Gravity estimated from the same recording absorbs an error that is there throughout, so these
effects describe a change. An error against an earlier model or a robot description is found by
comparing that with a fit.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.terms.change_points import change_factor, ChangeEffect
from gravity_comp_ros.terms.effect import Coefficient, Setting, Sizes
from gravity_comp_ros.terms.motion import Motion
import numpy as np

# Minimum gravity gradient, in N·m/rad.
_MIN_GRADIENT = 0.05


class EncoderOffset(ChangeEffect):
    """Offset of a joint's zero angle that begins at a change point."""

    name = 'encoder_offset'
    coefficients = (Coefficient('delta', 'rad', 'change of the true angle minus the reported '
                                                'angle'),)
    scope = 'arm'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        factor = change_factor(motion, setting)
        return (motion.gradient[:, :, joint] * factor[:, None])[:, :, None]

    def prior_std(self, sizes: Sizes) -> FloatArray:
        return np.array([0.05])

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if reason := super().untestable(motion, joint):
            return reason
        slope = float(np.sqrt(np.mean(motion.gradient[:, :, joint] ** 2, axis=0)).max())
        if slope < _MIN_GRADIENT:
            return f'no gravity torque depends on the angle of this joint ({slope:.2g} N·m/rad)'
        return None


class BaseTilt(ChangeEffect):
    """The columns are the torque of all joints per tilt of the base, negative before it."""

    name = 'base_tilt'
    coefficients = (Coefficient('alpha', 'rad', 'change of the tilt about the first axis of the '
                                                'frame of the first joint'),
                    Coefficient('beta', 'rad', 'the same about the second axis'))
    scope = 'arm'
    per_joint = False

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return _tilted(motion) * change_factor(motion, setting)[:, None, None]

    def prior_std(self, sizes: Sizes) -> FloatArray:
        return np.full(2, 0.1)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.chain is None:
            return 'a base tilt requires a serial arm as the model of gravity'
        if reason := super().untestable(motion, joint):
            return reason
        slope = float(np.sqrt(np.mean(_tilted(motion) ** 2, axis=0)).max())
        if slope < _MIN_GRADIENT:
            return f'no gravity torque depends on a tilt of the base ({slope:.2g} N·m/rad)'
        return None


def _tilted(motion: Motion) -> FloatArray:
    """Return the torque of all joints per tilt of the base, (M, N, 2) in N·m/rad."""
    assert motion.chain is not None
    if 'tilt' not in motion.of_gravity:
        kinematics = ForwardKinematics(motion.chain.axes, motion.samples.q)
        motion.of_gravity['tilt'] = kinematics.axis_columns(
            motion.chain.moments)[:2].transpose(2, 1, 0)
    return motion.of_gravity['tilt']


EFFECTS = (EncoderOffset(), BaseTilt())
