"""
Six-axis arm with parallel shoulder, elbow and first wrist axes.

Lengths and masses are rounded from the public description of Universal Robots' UR10 (10 kg
payload, 1.3 m reach); inertias are those of solid cylinders of the links' size.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm, serial_model
import numpy as np
import pinocchio as pin

# One row per joint: origin xyz in m and rpy in rad from the parent's frame; every axis is +z.
_ORIGINS = (
    ((0.0, 0.0, 0.127), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (pi / 2, 0.0, 0.0)),
    ((-0.612, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ((-0.572, 0.0, 0.164), (0.0, 0.0, 0.0)),
    ((0.0, -0.116, 0.0), (pi / 2, 0.0, 0.0)),
    ((0.0, 0.092, 0.0), (pi / 2, pi, pi)),
)
# One row per link: mass in kg, centre of mass in m in the link's frame; radius in m, length in m
# and axis of the substitute cylinder.
_LINKS = (
    (7.1, (0.021, -0.027, 0.0), 0.075, 0.18, 2),
    (12.7, (-0.232, 0.002, 0.158), 0.075, 0.61, 0),
    (4.27, (-0.331, 0.001, 0.068), 0.06, 0.57, 0),
    (2.0, (0.003, -0.018, 0.006), 0.06, 0.12, 1),
    (2.0, (-0.003, 0.016, 0.004), 0.06, 0.12, 1),
    (0.62, (0.015, -0.011, -0.024), 0.045, 0.06, 2),
)
_SPEED = (2.09, 2.09, 3.14, 3.14, 3.14, 3.14)
NAMES = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
         'wrist_2_joint', 'wrist_3_joint')


def six_axis(names: Sequence[str] | None = None) -> Arm:
    """
    Return the six-axis arm, with limits of ±2.8 rad, ±2.6 rad at the elbow.

    :param names: six joint names; the names of Universal Robots if not given.
    :raises OptionError: if there are not six names.
    """
    joints = tuple(names) if names else NAMES
    if len(set(joints)) != 6:
        raise OptionError(f'the arm has 6 joints; {len(joints)} names given, or they repeat')
    bodies = [pin.Inertia(mass, np.array(com), _cylinder(mass, radius, length, axis))
              for mass, com, radius, length, axis in _LINKS]
    upper = np.array([2.8, 2.8, 2.6, 2.8, 2.8, 2.8])
    return Arm('six_axis', joints, serial_model('six_axis', joints, _ORIGINS, bodies), -upper,
               upper, np.array(_SPEED))


def _cylinder(mass: float, radius: float, length: float, axis: int) -> np.ndarray:
    """Return the inertia (3, 3) in kg·m² of a solid cylinder about its centre."""
    across = mass * (3 * radius ** 2 + length ** 2) / 12
    diagonal = np.full(3, across)
    diagonal[axis] = mass * radius ** 2 / 2
    return np.diag(diagonal)
