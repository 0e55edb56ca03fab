"""
Fourteen real arms, five to seven revolute joints, from the descriptions of `example-robot-data`.

Joints that do not belong to the chain (torso, head, legs, other arm, fingers) are locked at their
neutral position, at 0 or at the middle of their limits if 0 is outside. The URDF of the chain
that remains is the only source of the simulated arm, so that description and simulation agree.

Three further ones have joint axes from the makers' data sheets (`data_sheet_urdf`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
import math
from pathlib import Path
import tempfile
from xml.etree import ElementTree

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.arms import Arm, from_urdf
import numpy as np
import pinocchio as pin

PACKAGE = 'example-robot-data'
_HALF = math.pi / 2


@dataclass(frozen=True)
class Source:
    """Description file of a robot in the package, and the names of an arm's joints, base first."""

    file: str
    joints: tuple[str, ...]


def _numbered(pattern: str, count: int) -> tuple[str, ...]:
    return tuple(pattern.format(n) for n in range(1, count + 1))


_UR = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', *_numbered('wrist_{}_joint', 3))
SOURCES: dict[str, Source] = {
    'ur3': Source('ur_description/urdf/ur3_robot.urdf', _UR),
    'ur5': Source('ur_description/urdf/ur5_robot.urdf', _UR),
    'ur10': Source('ur_description/urdf/ur10_robot.urdf', _UR),
    'panda': Source('panda_description/urdf/panda.urdf', _numbered('panda_joint{}', 7)),
    'kinova': Source('kinova_description/robots/kinova.urdf', _numbered('j2s6s200_joint_{}', 6)),
    'xarm7': Source('xarm_description/urdf/xarm7.urdf', _numbered('joint{}', 7)),
    'z1': Source('z1_description/urdf/z1.urdf', _numbered('joint{}', 6)),
    'so101': Source('so_arm_description/urdf/so101.urdf', (
        'shoulder_pan', 'shoulder_lift', 'elbow_flex', 'wrist_flex', 'wrist_roll')),
    'tiago': Source('tiago_description/robots/tiago_no_hand.urdf', _numbered('arm_{}_joint', 7)),
    'tiago_pro': Source('tiago_pro_description/robots/tiago_pro.urdf',
                        _numbered('arm_left_{}_joint', 7)),
    'baxter': Source('baxter_description/urdf/baxter.urdf', tuple(
        f'left_{part}' for part in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2'))),
    'pr2': Source('pr2_description/urdf/pr2.urdf', tuple(f'r_{part}_joint' for part in (
        'shoulder_pan', 'shoulder_lift', 'upper_arm_roll', 'elbow_flex', 'forearm_roll',
        'wrist_flex', 'wrist_roll'))),
    'romeo': Source('romeo_description/urdf/romeo_small.urdf', tuple(f'L{part}' for part in (
        'ShoulderPitch', 'ShoulderYaw', 'ElbowRoll', 'ElbowYaw', 'WristRoll', 'WristYaw',
        'WristPitch'))),
    'talos': Source('talos_data/robots/talos_reduced.urdf', _numbered('arm_left_{}_joint', 7)),
}


# D-H parameters after J. J. Craig: a (m) and alpha (rad) of the previous link, d (m) of the joint.
_UR10 = ((0.0, 0.0, 0.1273), (0.0, _HALF, 0.0), (-0.612, 0.0, 0.0), (-0.5723, 0.0, 0.163941),
         (0.0, _HALF, 0.1157), (0.0, -_HALF, 0.0922))
_PANDA = ((0.0, 0.0, 0.333), (0.0, -_HALF, 0.0), (0.0, _HALF, 0.316), (0.0825, _HALF, 0.0),
          (-0.0825, -_HALF, 0.384), (0.0, _HALF, 0.0), (0.088, _HALF, 0.0))
_MED7 = ((0.0, 0.0, 0.34), (0.0, -_HALF, 0.0), (0.0, _HALF, 0.4), (0.0, _HALF, 0.0),
         (0.0, -_HALF, 0.4), (0.0, -_HALF, 0.0), (0.0, _HALF, 0.126))
DATA_SHEETS = {'ur10': _UR10, 'panda': _PANDA, 'med7': _MED7}


def descriptions() -> Path | None:
    """Return the folder of the installed descriptions, None if the package is missing."""
    folder = Path(pin.__file__).parents[4] / 'share' / PACKAGE / 'robots'
    return folder if folder.is_dir() else None


@cache
def urdf(name: str) -> str:
    """
    Return the URDF of an arm of `SOURCES` as a serial chain without meshes.

    :raises OptionError: if there is no such arm, or the package is not installed.
    """
    if name not in SOURCES:
        raise OptionError(f'no arm {name}; there are {", ".join(SOURCES)}')
    folder = descriptions()
    if folder is None:
        raise OptionError(f'the robot descriptions are missing: pip install {PACKAGE}')
    source = SOURCES[name]
    robot = pin.buildModelFromUrdf(str(folder / source.file))
    locked = [n for n in range(1, robot.njoints) if robot.names[n] not in source.joints]
    lower, upper = robot.lowerPositionLimit, robot.upperPositionLimit
    pose = pin.neutral(robot)
    middle = (pose < lower) | (pose > upper)
    pose[middle] = 0.5 * (lower + upper)[middle]
    return _chain_urdf(name, pin.buildReducedModel(robot, locked, pose))


def arm_of(description: str) -> Arm:
    """Return the simulated arm of a URDF text."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.urdf'
        path.write_text(description, encoding='utf-8')
        return from_urdf(path)


def with_other_masses(description: str, seed: int) -> str:
    """
    Return a URDF text whose masses and inertias are not those of the arm.

    Masses change by factors with a standard deviation of 25 %, inertias by further 30 %.
    """
    rng, tree = np.random.default_rng([seed, 35]), ElementTree.fromstring(description)
    for inertial in tree.iter('inertial'):
        mass, inertia = np.exp(np.cumsum([0.25, 0.3] * rng.standard_normal(2)))
        for part, factor in (('mass', mass), ('inertia', inertia)):
            each = inertial.find(part)
            each.attrib = {key: repr(float(value) * float(factor))
                           for key, value in each.attrib.items()}
    return ElementTree.tostring(tree, encoding='unicode')


@contextmanager
def described(description: str, seed: int) -> Iterator[Path]:
    """Yield the file of a description `with_other_masses`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'arm.urdf'
        path.write_text(with_other_masses(description, seed), encoding='utf-8')
        yield path


def _chain_urdf(name: str, model: pin.Model) -> str:
    """Return the URDF of a Pinocchio model that is a chain of revolute joints."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    parts = [f'<robot name="{name}">', '<link name="base"/>']
    for n in range(1, model.njoints):
        if model.parents[n] != n - 1 or model.joints[n].nv != 1:
            raise OptionError(f'{name}: {model.names[n]} does not continue a chain of single axes')
        body, placement = model.inertias[n], model.jointPlacements[n]
        axis = pin.getJointJacobian(model, data, n, pin.LOCAL)[3:, model.joints[n].idx_v]
        low, high = _limits(model, n)
        speed = float(np.clip(model.velocityLimit[model.joints[n].idx_v], 0.5, 10.0))
        inertia = ' '.join(f'{key}="{float(body.inertia[at])!r}"' for key, at in (
            ('ixx', (0, 0)), ('iyy', (1, 1)), ('izz', (2, 2)), ('ixy', (0, 1)), ('ixz', (0, 2)),
            ('iyz', (1, 2))))
        parts.append(
            f'<link name="{model.names[n]}_link"><inertial><origin xyz="{_text(body.lever)}"/>'
            f'<mass value="{float(body.mass)!r}"/><inertia {inertia}/></inertial></link>'
            f'<joint name="{model.names[n]}" type="revolute">'
            f'<parent link="{model.names[n - 1] + "_link" if n > 1 else "base"}"/>'
            f'<child link="{model.names[n]}_link"/><origin xyz="{_text(placement.translation)}" '
            f'rpy="{_text(pin.rpy.matrixToRpy(placement.rotation))}"/>'
            f'<axis xyz="{_text(axis)}"/>'
            f'<limit lower="{low!r}" upper="{high!r}" effort="400" velocity="{speed!r}"/></joint>')
    return '\n'.join([*parts, '</robot>'])


def _limits(model: pin.Model, n: int) -> tuple[float, float]:
    """Return the position limits in rad, within half a turn to either side."""
    joint = model.joints[n]
    if joint.nq != 1:
        return -np.pi, np.pi
    return (max(float(model.lowerPositionLimit[joint.idx_q]), -np.pi),
            min(float(model.upperPositionLimit[joint.idx_q]), np.pi))


def _text(values: np.ndarray) -> str:
    return ' '.join(repr(float(x)) for x in values)


def data_sheet_urdf(arm: str, joints: tuple[str, ...]) -> str:
    """
    Return the URDF of an arm (a key of `DATA_SHEETS`) with the given joint names.

    Masses are not real: every link has 1 kg, so that Pinocchio accepts the description as well.
    """
    parts = ['<robot name="arm"><link name="link_0"/>']
    for n, (name, (a, alpha, d)) in enumerate(zip(joints, DATA_SHEETS[arm]), 1):
        xyz = f'{a} {-math.sin(alpha) * d} {math.cos(alpha) * d}'
        parts.append(
            f'<link name="link_{n}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" '
            f'izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="revolute"><parent link="link_{n - 1}"/>'
            f'<child link="link_{n}"/><origin xyz="{xyz}" rpy="{alpha} 0 0"/><axis xyz="0 0 1"/>'
            f'<limit lower="-6.3" upper="6.3" effort="400" velocity="4"/></joint>')
    return ''.join([*parts, '</robot>'])
