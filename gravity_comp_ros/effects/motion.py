"""
From samples and a gravity model to what effects are computed from.

Acceleration is the slope of a cubic fitted to the speed over a short window, on either side of
each sample alike and within one run, so that nothing is shifted in time. The predicted torque
comes from the model in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.differentiation import differentiate, DifferentiationOptions
from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Motion
from gravity_comp_ros.effects.motion_direction import find_shape, least_widths
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np


@dataclass(frozen=True)
class MotionOptions:
    """
    How acceleration is found: cubic fits to the speed over `window` s.

    0.3 s passes what an arm in careful motion does (up to about 2 Hz) and keeps a speed noise
    of 1 mrad/s at 50 Hz to about 0.006 rad/s^2.

    :raises OptionError: if the window is not positive.
    """

    window: float = 0.3

    def __post_init__(self) -> None:
        if not np.isfinite(self.window) or self.window <= 0:
            raise OptionError(f'acceleration window is {self.window} s; it must be positive')


def build_motion(samples: JointSamples, model: GravityModel,
                 options: MotionOptions = MotionOptions()) -> Motion:
    """
    Return what effect columns are computed from; joints are put in the model's order.

    :raises DataError: if there are no samples.
    :raises ModelMismatchError: if a joint of the model is not among the samples'.
    """
    samples = samples.joints(model.joints)
    if not len(samples):
        raise DataError('no samples to look for effects in')
    gravity = model.predict(samples.q)
    residual, least = samples.tau - gravity, least_widths(samples)
    qdd = accelerations(samples, options)
    shapes = [find_shape(samples, samples.q[:, n], samples.qd[:, n], qdd[:, n], residual[:, n],
                         float(least[n])) for n in range(samples.n_joints)]
    return Motion(samples, qdd, gravity, None, np.array([shape.width for shape in shapes]), model,
                  np.array([shape.hold for shape in shapes]))


def accelerations(samples: JointSamples, options: MotionOptions = MotionOptions()) -> FloatArray:
    """Return qdd (M, N) in rad/s^2, each run for itself; 0 where a sample is alone in time."""
    qdd = np.zeros_like(samples.qd)
    if not samples.qd.any():
        return qdd
    how = DifferentiationOptions(window=options.window)
    for run in run_slices(samples):
        qdd[run] = differentiate(samples.t[run], samples.qd[run], how)
    return np.nan_to_num(qdd, nan=0.0)
