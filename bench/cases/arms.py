"""Arms of the cases: six axes like a UR10, and randomly generated arms with their slow motion."""

from __future__ import annotations

from math import pi

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation.arms import Arm, empty_model, serial_model, with_base_tilt
from gravity_comp_ros.simulation.motions import Motion, sample, sines
import numpy as np
import pinocchio as pin

# Joint limit in rad, and largest speed of the slow motion in rad/s.
_LIMIT = 2.6
_SPEED = 0.15
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
_SPEEDS = (2.09, 2.09, 3.14, 3.14, 3.14, 3.14)
_NAMES = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
          'wrist_2_joint', 'wrist_3_joint')


def six_axis() -> Arm:
    """
    Return an arm with parallel shoulder, elbow and first wrist axes, limits of ±2.6 and ±2.8 rad.

    Lengths and masses are rounded from the public description of Universal Robots' UR10 (10 kg
    payload, 1.3 m reach); inertias are those of solid cylinders of the links' size.
    """
    bodies = [pin.Inertia(mass, np.array(com), _cylinder(mass, radius, length, axis))
              for mass, com, radius, length, axis in _LINKS]
    upper = np.array([2.8, 2.8, 2.6, 2.8, 2.8, 2.8])
    return Arm('six_axis', _NAMES, serial_model('six_axis', _NAMES, _ORIGINS, bodies), -upper,
               upper, np.array(_SPEEDS))


def _cylinder(mass: float, radius: float, length: float, axis: int) -> np.ndarray:
    """Return the inertia (3, 3) in kg·m² of a solid cylinder about its centre."""
    across = mass * (3 * radius ** 2 + length ** 2) / 12
    diagonal = np.full(3, across)
    diagonal[axis] = mass * radius ** 2 / 2
    return np.diag(diagonal)


def generated_arm(seed: int, n_joints: int | None = None, right_angles: bool = False) -> Arm:
    """
    Return a random arm: links of 5 to 40 cm and 2 to 5 kg, lighter and shorter at the wrist.

    The base of every other pair of seeds is tilted by up to 1 rad in roll and pitch. Joint limits
    are ±2.6 rad.

    :param n_joints: six for even and seven for odd seeds, if not given.
    :param right_angles: rotations between the axes are multiples of 90 degrees.
    """
    rng = np.random.default_rng([seed, int(right_angles)])
    n = n_joints or 6 + seed % 2
    model, parent = empty_model(f'generated_{seed}'), 0
    names = tuple(f'joint_{k + 1}' for k in range(n))
    for k, name in enumerate(names):
        wrist = k >= n - 2
        direction = rng.normal(size=3)
        length = rng.uniform(0.05, 0.15 if wrist else 0.4)
        origin = length * direction / np.linalg.norm(direction)
        rotation = _random_rotation(rng, right_angles) if k else np.eye(3)
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(rotation, origin), name)
        mass = rng.uniform(0.5, 2.5) if wrist else rng.uniform(2.0, 5.0)
        inertia = np.diag(rng.uniform(0.005, 0.03, 3))
        model.appendBodyToJoint(parent, pin.Inertia(mass, rng.normal(scale=0.08, size=3), inertia),
                                pin.SE3.Identity())
    limit = np.full(n, _LIMIT)
    arm = Arm(f'generated_{seed}', names, model, -limit, limit, np.full(n, 1.5))
    if seed // 2 % 2:
        return with_base_tilt(arm, *rng.uniform(-1.0, 1.0, 2))
    return arm


def small_motion(arm: Arm, seed: int, duration: float = 100.0, rate: float = 5.0,
                 start: float = 0.0) -> Motion:
    """
    Return a slow motion like Yu 2022, Eq. (17): one sine per joint, 0.4 to 0.7 rad.

    Speeds are below 0.15 rad/s.
    """
    rng = np.random.default_rng([seed, 17])
    n = arm.n_joints
    amplitude = rng.uniform(0.4, 0.7, n)
    omega = rng.uniform(0.5, 1.0, n) * _SPEED / amplitude
    phase, centre = rng.uniform(0.0, 2 * np.pi, n), rng.uniform(-0.5, 0.5, n)
    return sample('small', sines(amplitude, omega, phase, centre), duration, rate, start)


def _random_rotation(rng: np.random.Generator, right_angles: bool) -> FloatArray:
    """Return a random rotation between two joint frames."""
    if right_angles:
        quarters = rng.integers(0, 4, 2) * np.pi / 2
        return np.asarray(pin.rpy.rpyToMatrix(quarters[0], 0.0, quarters[1]))
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(q * np.sign(np.linalg.det(q)))
