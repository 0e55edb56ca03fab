"""
Geometric errors that begin during a recording: encoder offsets and base tilt.

Gravity estimated from the same recording absorbs an error that is there throughout, so these
effects describe a change. An error against an earlier model or a robot description is found by
comparing that with a fit.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.change_points import change_factor, ChangeEffect
from gravity_comp_ros.effects.effect import Coefficient, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
import numpy as np

# Minimum gravity gradient, in N·m/rad.
_MIN_GRADIENT = 0.05


class EncoderOffset(ChangeEffect):
    """Offset of a joint's zero angle that begins at a change point."""

    name = 'encoder_offset'
    title = 'Encoder offset'
    family = 'geometry'
    equation = 'tau = -delta dg(q)/dq_n before a time'
    description = ('Zero angle of a joint that changes, for example by a slipping coupling. It '
                   'changes the torque of all joints.')
    coefficients = (Coefficient('delta', 'rad', 'change of the true angle minus the reported '
                                                'angle'),)
    confounders = ('base_tilt', 'payload_change', 'joint_flexibility')
    experiment = 'move joint {joint} to its calibration mark and read its angle'
    signature = 'position'
    source = 'Yu 2022, Eq. (2), expanded to first order in one angle'
    scope = 'arm'
    largest = 0.3
    why_not_larger = 'a linear model of the offset is inaccurate at this size; fit a new model'
    std = 0.05

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        factor = change_factor(motion, setting)
        return (motion.gradient[:, :, joint] * factor[:, None])[:, :, None]

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
    title = 'Base tilt'
    family = 'geometry'
    equation = 'tau = -alpha dg/dalpha - beta dg/dbeta before a time'
    description = ('Base that tilts during the recording, as that of a mobile robot. A tilt that '
                   'is there throughout is a part of the gravity model.')
    coefficients = (Coefficient('alpha', 'rad', 'change of the tilt about the first axis of the '
                                                'frame of the first joint'),
                    Coefficient('beta', 'rad', 'the same about the second axis'))
    confounders = ('encoder_offset', 'joint_spring', 'payload_change')
    experiment = ('check the base with a spirit level; move the first joint over its whole range '
                  'with the arm extended horizontally')
    signature = 'position of joint 1'
    source = ('R. Featherstone, Rigid Body Dynamics Algorithms, Springer, 2008 (gravity as an '
              'acceleration of the base)')
    scope = 'arm'
    per_joint = False
    largest = 0.35
    why_not_larger = 'such a tilt would be visible'
    std = 0.1

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return _tilted(motion) * change_factor(motion, setting)[:, None, None]

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
