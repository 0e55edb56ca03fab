"""
Nominal dynamic torque of an arm with known axes, subtracted before gravity is fitted.

A nominal arm on the axes of a description, with the first moments of gravity, has nearly the
inertias of the real arm (`models.kinematic.nominal_arm`). If its dynamic torque is not
subtracted, inertia appears as a tilt of the base, because the first joint has no other gravity
torque. An acceleration of 0.1 rad/s^2 corresponds to a degree.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import evenly_picked, FloatArray, JointSamples
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import regressor
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

# Effects that describe the dynamic torque; with one of them it is not subtracted.
MOTION_EFFECTS = ('rigid_body_dynamics', 'inertia', 'coriolis')
# Maximum number of samples that first moments are fitted to, and of rows of one regressor.
_MAX_MOMENT_SAMPLES, _MAX_ROWS = 300, 4096
# Minimum singular value of an excited direction, relative to the largest.
_MIN_EXCITATION = 1e-3


def without_motion(samples: JointSamples, geometry: Geometry, qdd: FloatArray) -> JointSamples:
    """
    Return the samples without the dynamic torque of the nominal arm.

    :param geometry: the axes of the samples' joints, in their order.
    :param qdd: accelerations (M, N), rad/s^2.
    """
    if not (samples.qd.any() or qdd.any()):
        return samples
    torque = motion_torque(samples, geometry, _first_moments(samples, geometry), qdd)
    return replace(samples, tau=samples.tau - torque)


def motion_torque(samples: JointSamples, geometry: Geometry, moments: FloatArray,
                  qdd: FloatArray) -> FloatArray:
    """
    Return the dynamic torque (M, N) in N·m of the nominal arm with given first moments.

    :param geometry: the axes of the samples' joints, in their order.
    :param moments: (N, 2) in kg·m, as `nominal_parameters` takes them.
    :param qdd: accelerations (M, N), rad/s^2.
    """
    parameters = nominal_parameters(geometry, moments)
    torque = [regressor(geometry, samples.q[rows], samples.qd[rows], qdd[rows]) @ parameters
              for start in range(0, len(samples), _MAX_ROWS)
              for rows in [slice(start, start + _MAX_ROWS)]]
    return np.concatenate(torque)


def _first_moments(samples: JointSamples, geometry: Geometry) -> FloatArray:
    """Return first moments (N, 2) in kg·m, fitted jointly with Coulomb friction and offsets."""
    rows, n = evenly_picked(samples.n_samples, _MAX_MOMENT_SAMPLES), samples.n_joints
    q, signs = samples.q[rows], np.sign(samples.qd[rows])
    gravity = ForwardKinematics(geometry.rotations, q).moment_columns().transpose(2, 1, 0)
    each = np.eye(n)[None]
    columns = np.concatenate([gravity, np.tile(each, (len(q), 1, 1)), signs[:, :, None] * each],
                             axis=2)
    coefficients = lstsq(columns.reshape(-1, 4 * n), samples.tau[rows].ravel(),
                         rcond=_MIN_EXCITATION)
    return np.asarray(coefficients[:2 * n].reshape(n, 2) / STANDARD_GRAVITY)
