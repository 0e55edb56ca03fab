"""
Nominal dynamic torque of an arm with known axes, subtracted before gravity is fitted.

A nominal arm on the axes of a description, with the first moments of gravity, has nearly the
inertias of the real arm (`models.kinematic.nominal_arm`). If its dynamic torque is not
subtracted, inertia appears as a tilt of the base, because the first joint has no other gravity
torque. An acceleration of 0.1 rad/s^2 corresponds to a degree.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import inverse_dynamics


def motion_torque(samples: JointSamples, geometry: Geometry, moments: FloatArray,
                  qdd: FloatArray) -> FloatArray:
    """
    Return the dynamic torque (M, N) in N·m of the nominal arm with given first moments.

    :param geometry: the axes of the samples' joints, in their order.
    :param moments: (N, 2) in kg·m, as `nominal_parameters` takes them.
    :param qdd: accelerations (M, N), rad/s^2.
    """
    parameters = nominal_parameters(geometry, moments)
    return inverse_dynamics(geometry, samples.q, samples.qd, qdd, parameters)
