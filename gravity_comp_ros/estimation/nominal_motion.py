"""
The torque of motion of an arm with known axes, taken off before gravity is fitted.

Where a description gives the axes, a nominal arm with the first moments of gravity has nearly the
inertias of the real one (`models.kinematic.nominal_arm`). Without its torque of motion a fit takes
inertia for a small tilt of the base: the first joint carries no other gravity. Even 0.1 rad/s^2
are enough for a degree.
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

# Effects that describe the torque of motion, beside which it is not taken off.
MOTION_EFFECTS = ('rigid_body_dynamics', 'inertia', 'coriolis')
# Samples that the first moments are read from, and those whose regressor is built at once.
_POSES, _AT_ONCE = 300, 4096
# Directions that the motion excites less, next to the most excited, are left out.
_EXCITED = 1e-3


def without_motion(samples: JointSamples, geometry: Geometry, qdd: FloatArray) -> JointSamples:
    """
    Return the samples without the torque of motion of the nominal arm.

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
    Return the torque of motion (M, N) in N·m of the nominal arm with given first moments.

    :param geometry: the axes of the samples' joints, in their order.
    :param moments: (N, 2) in kg·m, as `nominal_parameters` takes them.
    :param qdd: accelerations (M, N), rad/s^2.
    """
    parameters = nominal_parameters(geometry, moments)
    torque = [regressor(geometry, samples.q[rows], samples.qd[rows], qdd[rows]) @ parameters
              for start in range(0, len(samples), _AT_ONCE)
              for rows in [slice(start, start + _AT_ONCE)]]
    return np.concatenate(torque)


def _first_moments(samples: JointSamples, geometry: Geometry) -> FloatArray:
    """Return first moments (N, 2) in kg·m by least squares, dry friction and offsets beside."""
    rows, n = evenly_picked(samples.n_samples, _POSES), samples.n_joints
    q, ways = samples.q[rows], np.sign(samples.qd[rows])
    gravity = ForwardKinematics(geometry.rotations, q).moment_columns().transpose(2, 1, 0)
    each = np.eye(n)[None]
    columns = np.concatenate([gravity, np.tile(each, (len(q), 1, 1)), ways[:, :, None] * each],
                             axis=2)
    found = lstsq(columns.reshape(-1, 4 * n), samples.tau[rows].ravel(), rcond=_EXCITED)
    return np.asarray(found[:2 * n].reshape(n, 2) / STANDARD_GRAVITY)
