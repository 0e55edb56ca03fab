"""Rigid-body models of arms: the KUKA LBR iiwa 7 R800 from tables, and any URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi, radians
from pathlib import Path

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
import numpy as np
from numpy.typing import ArrayLike
import pinocchio as pin

# KUKA LBR iiwa 7 R800, from public robot descriptions (IFL-CAMP/iiwa_stack, BSD-2). One row per
# joint: origin xyz in m and rpy in rad from the parent's frame; every axis is +z.
_IIWA7_ORIGINS = (
    ((0.0, 0.0, 0.15), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.19), (pi / 2, 0.0, pi)),
    ((0.0, 0.21, 0.0), (pi / 2, 0.0, pi)),
    ((0.0, 0.0, 0.19), (pi / 2, 0.0, 0.0)),
    ((0.0, 0.21, 0.0), (-pi / 2, pi, 0.0)),
    ((0.0, 0.0607, 0.19), (pi / 2, 0.0, 0.0)),
    ((0.0, 0.081, 0.0607), (-pi / 2, pi, 0.0)),
)
_IIWA7_LIMIT_DEG = (170.0, 120.0, 170.0, 120.0, 170.0, 120.0, 175.0)
_IIWA7_SPEED_DEG = (98.0, 98.0, 100.0, 130.0, 140.0, 180.0, 180.0)
# One row per link: mass in kg, centre of mass in m, and ixx, iyy, izz, ixy, ixz, iyz in kg m^2
# about the centre of mass, all in the link's frame.
_IIWA7_LINKS = (
    (3.4525, (0.0, -0.03, 0.12), (0.02183, 0.007703, 0.02083, 0.0, 0.0, -0.003887)),
    (3.4821, (0.0003, 0.059, 0.042), (0.02076, 0.02179, 0.00779, 0.0, -0.003626, 0.0)),
    (4.05623, (0.0, 0.03, 0.13), (0.03204, 0.00972, 0.03042, 0.0, 0.0, 0.006227)),
    (3.4822, (0.0, 0.067, 0.034), (0.02178, 0.02075, 0.007785, 0.0, 0.0, -0.003625)),
    (2.1633, (0.0001, 0.021, 0.076), (0.01287, 0.005708, 0.01112, 0.0, 0.0, -0.003946)),
    (2.3466, (0.0, 0.0006, 0.0004), (0.006509, 0.006259, 0.004527, 0.0, 0.0, 0.00031891)),
    (3.129, (0.0, 0.0, 0.02), (0.01464, 0.01465, 0.002872, 0.0005912, 0.0, 0.0)),
)


@dataclass(frozen=True, eq=False)
class Arm:
    """
    A fixed-base arm of N revolute joints with its rigid-body model.

    `joints` has the N joint names in the model's order; `lower`, `upper` (N,) are position
    limits in rad and `max_speed` (N,) speed limits in rad/s. The functions of this module leave
    `model` unchanged and return new arms.
    """

    name: str
    joints: tuple[str, ...]
    model: pin.Model
    lower: FloatArray
    upper: FloatArray
    max_speed: FloatArray

    @property
    def n_joints(self) -> int:
        return len(self.joints)


@dataclass(frozen=True)
class Payload:
    """
    A point mass fixed to the last link.

    `mass` in kg; `com` is its place in m in the frame of the last joint's link.
    """

    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.1)


def iiwa7() -> Arm:
    """Return the KUKA LBR iiwa 7 R800, the simulated arm of Yu 2022, Table 1."""
    joints = tuple(f'iiwa_joint_{n}' for n in range(1, 8))
    upper = np.radians(_IIWA7_LIMIT_DEG)
    speed = np.radians(_IIWA7_SPEED_DEG)
    bodies = [pin.Inertia(mass, np.array(com), _inertia_matrix(inertia))
              for mass, com, inertia in _IIWA7_LINKS]
    return Arm('iiwa7', joints, serial_model('iiwa7', joints, _IIWA7_ORIGINS, bodies), -upper,
               upper, speed)


def from_urdf(path: str | Path) -> Arm:
    """
    Return the arm of a URDF file; fixed joints are merged, meshes are not used.

    A continuous joint gets limits of ±pi; a joint without a speed limit gets 100 deg/s.

    :raises OptionError: if the file cannot be read, has no moving joint, or has a joint that
        is not revolute: the force of a prismatic joint is not a sum of products of sines and
        cosines of the joint angles, as the models of this package are.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = (getattr(error, 'strerror', None) or 'it is not text').lower()
        raise OptionError(f'cannot read URDF {path}: {reason}') from None
    try:
        model = pin.buildModelFromXML(text)
    except (ValueError, RuntimeError) as error:
        reason = ' '.join(str(error).split())
        raise OptionError(f'{path} is not a URDF of a robot: {reason}') from None
    model.gravity.linear = _level()
    joints = tuple(model.names)[1:]
    if not joints:
        raise OptionError(f'URDF {path} has no moving joint')
    lower, upper = np.full(len(joints), -pi), np.full(len(joints), pi)
    for n, joint_model in enumerate(list(model.joints)[1:]):
        _check_revolute(path, joints[n], joint_model)
        if joint_model.nq == 1:
            lower[n] = model.lowerPositionLimit[joint_model.idx_q]
            upper[n] = model.upperPositionLimit[joint_model.idx_q]
    speed = np.array(getattr(model, 'upperVelocityLimit', model.velocityLimit), dtype=float)
    speed[~((speed > 0) & (speed < 1e3))] = radians(100.0)
    limited = (upper > lower) & (upper - lower <= 1e3)
    return Arm(model.name or path.stem, joints, model, np.where(limited, lower, -pi),
               np.where(limited, upper, pi), speed)


def serial_model(name: str, joints: Sequence[str], origins: Sequence[Sequence[Sequence[float]]],
                 bodies: Sequence[pin.Inertia]) -> pin.Model:
    """
    Return a chain of revolute joints about z, each with a body.

    :param origins: xyz in m and rpy in rad of each joint in the frame of its parent.
    """
    model, parent = empty_model(name), 0
    for joint, (xyz, rpy), body in zip(joints, origins, bodies):
        placement = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, joint)
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    return model


def empty_model(name: str) -> pin.Model:
    """Return a model without joints in standard gravity; Pinocchio's default is 9.81."""
    model = pin.Model()
    model.name = name
    model.gravity.linear = _level()
    return model


def renamed(arm: Arm, names: Sequence[str]) -> Arm:
    """
    Return the arm with other joint names.

    :raises OptionError: if the numbers of names and joints differ, or names repeat.
    """
    if len(names) != arm.n_joints or len(set(names)) < len(names):
        raise OptionError(f'{arm.name} has {arm.n_joints} joints; {len(names)} names given, or '
                          f'they repeat')
    return replace(arm, joints=tuple(names))


def with_payload(arm: Arm, payload: Payload) -> Arm:
    """Return the arm with a payload fixed to its last link."""
    model = arm.model.copy()
    last = model.njoints - 1
    model.appendBodyToJoint(
        last, pin.Inertia(payload.mass, np.array(payload.com), np.zeros((3, 3))),
        pin.SE3.Identity())
    return replace(arm, model=model)


def with_base_tilt(arm: Arm, roll: float, pitch: float) -> Arm:
    """
    Return the arm on a base rotated by roll about x, then by pitch about y.

    :param roll: rad. :param pitch: rad.
    """
    model = arm.model.copy()
    base = pin.rpy.rpyToMatrix(roll, pitch, 0.0)
    model.gravity.linear = base.T @ _level()
    return replace(arm, model=model)


def gravity_torque(arm: Arm, q: ArrayLike) -> FloatArray:
    """
    Return the gravity torque (M, N) in N·m of M poses.

    :param q: joint angles (M, N) in rad.
    """
    poses = _rows(arm, q)
    data = arm.model.createData()
    return np.array([pin.computeGeneralizedGravity(arm.model, data, _configuration(arm, pose))
                     for pose in poses]).reshape(poses.shape)


def inverse_dynamics(arm: Arm, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> FloatArray:
    """
    Return the torque (M, N) in N·m of the rigid arm in motion (Yu 2022, Eq. (1)).

    :param q: joint angles (M, N) in rad.
    :param qd: joint speeds (M, N) in rad/s.
    :param qdd: joint accelerations (M, N) in rad/s².
    """
    poses, speeds, accelerations = _rows(arm, q), _rows(arm, qd), _rows(arm, qdd)
    data = arm.model.createData()
    return np.array([pin.rnea(arm.model, data, _configuration(arm, pose), v, a)
                     for pose, v, a in zip(poses, speeds, accelerations)]).reshape(poses.shape)


def _level() -> FloatArray:
    return np.array([0.0, 0.0, -STANDARD_GRAVITY])


def _rows(arm: Arm, values: ArrayLike) -> FloatArray:
    rows = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if rows.ndim != 2 or rows.shape[1] != arm.n_joints:
        raise OptionError(f'{arm.name} has {arm.n_joints} joints; got an array of {rows.shape}')
    return rows


def _configuration(arm: Arm, pose: FloatArray) -> FloatArray:
    """Return Pinocchio's configuration: a continuous joint is its cosine and sine."""
    if arm.model.nq == arm.model.nv:
        return pose
    return pin.integrate(arm.model, pin.neutral(arm.model), pose)


def _check_revolute(path: Path, joint: str, model: pin.JointModel) -> None:
    kind = model.shortname()
    if kind.startswith('JointModelP'):
        raise OptionError(
            f'joint {joint} of {path} is prismatic: its force is not a sum of sines and cosines, '
            f'as the gravity model is; only revolute joints are possible')
    if not kind.startswith('JointModelR'):
        raise OptionError(f'joint {joint} of {path} is a {kind}; only revolute joints are '
                          f'possible')


def _inertia_matrix(values: Sequence[float]) -> FloatArray:
    xx, yy, zz, xy, xz, yz = values
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
