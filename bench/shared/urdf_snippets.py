"""Short robot descriptions with the peculiarities of those of real robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
import numpy as np


def pinocchio_torque(text: str | bytes, joints: Sequence[str], q: np.ndarray,
                     held: Mapping[str, float] = MappingProxyType({}),
                     payload: tuple[float, np.ndarray] | None = None) -> np.ndarray:
    """
    Return the gravity torque (M, N) of joints of a URDF at q (M, N) by Pinocchio.

    :param held: positions of other joints; those that are not named are at 0.
    :param payload: mass in kg and centre (3,) in m in the frame of the last joint.
    """
    import pinocchio as pin
    text = text if isinstance(text, str) else text.decode()
    model = pin.buildModelFromXML(text.strip())
    model.gravity.linear = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    parts = {name: model.joints[model.getJointId(name)] for name in (*joints, *held)}
    if payload is not None:
        model.appendBodyToJoint(model.getJointId(joints[-1]),
                                pin.Inertia(*payload, np.zeros((3, 3))), pin.SE3.Identity())
    data, torques, rows = model.createData(), [], [parts[name].idx_v for name in joints]
    for pose in q:
        full = pin.neutral(model)
        for name, value in (*held.items(), *zip(joints, pose)):
            full[parts[name].idx_q] = value
        torques.append(pin.computeGeneralizedGravity(model, data, full)[rows])
    return np.array(torques)


def joint(name: str, parent: str, child: str, kind: str = 'revolute', xyz: str = '0 0 0.3',
          rpy: str = '0 0 0', axis: str | None = '0 0 1', extra: str = '') -> str:
    """Return a <joint> and its child <link>."""
    limit = ('<limit lower="-3" upper="3" effort="9" velocity="2"/>'
             if kind in ('revolute', 'prismatic') and '<limit' not in extra else '')
    along = f'<axis xyz="{axis}"/>' if axis else ''
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>{along}{limit}{extra}'
            f'</joint><link name="{child}"><inertial><origin xyz="0.02 0.05 0.1"/>'
            f'<mass value="1.5"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" '
            f'iyz="0"/></inertial></link>')


def robot(*parts: str, root: str = 'base_link') -> str:
    """Return a URDF."""
    return f'<?xml version="1.0"?><robot name="r"><link name="{root}"/>{"".join(parts)}</robot>'


def arm(names: Sequence[str], base: str, prefix: str = '', twist: str = '1.5707963 0 0.3') -> str:
    """Return a chain of revolute joints, each rotated by `twist` (rpy) from the previous one."""
    links = [base, *(f'{prefix}{name}_link' for name in names)]
    return ''.join(joint(name, links[n], links[n + 1], rpy=twist if n else '0 0 0',
                         xyz='0.05 -0.02 0.3') for n, name in enumerate(names))


UR_JOINTS = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
             'wrist_2_joint', 'wrist_3_joint')
# Universal Robots: fixed joints without axis or with axis 0 0 0, names without numbers.
UR = robot(
    joint('base_link-base_link_inertia', 'base_link', 'base_link_inertia', 'fixed', '0 0 0',
          '0 0 3.141592653589793', axis=None),
    arm(UR_JOINTS, 'base_link_inertia'),
    joint('flange-tool0', 'wrist_3_joint_link', 'tool0', 'fixed', axis='0 0 0'))

PANDA_JOINTS = tuple(f'panda_joint{n}' for n in range(1, 8))
# Franka: a fixed hand with two fingers, one of which mimics the other.
PANDA = robot(
    arm(PANDA_JOINTS, 'base_link'),
    joint('panda_hand_joint', 'panda_joint7_link', 'hand', 'fixed', axis='0 0 0'),
    joint('panda_finger_joint1', 'hand', 'leftfinger', 'prismatic', axis='0 1 0'),
    joint('panda_finger_joint2', 'hand', 'rightfinger', 'prismatic', axis='0 -1 0',
          extra='<mimic joint="panda_finger_joint1"/>'))

BAXTER_PARTS = ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2')
# Rethink's Baxter: two arms on a fixed torso, a head with a continuous joint.
BAXTER = robot(
    joint('torso_t0', 'base_link', 'torso', 'fixed', axis=None),
    joint('head_pan', 'torso', 'head', 'continuous'),
    *(joint(f'{side}_mount', 'torso', f'{side}_mount_link', 'fixed', f'0.06 {y} 0.1',
            f'0.002 0 {yaw}', axis='0 0 0')
      + arm([f'{side}_{part}' for part in BAXTER_PARTS], f'{side}_mount_link')
      for side, y, yaw in (('left', 0.26, 0.785), ('right', -0.26, -0.785))))

TIAGO_JOINTS = tuple(f'arm_{n}_joint' for n in range(1, 8))
# PAL's TIAGo: a prismatic torso before the arm, wheels, a gripper.
TIAGO = robot(
    joint('wheel_left_joint', 'base_link', 'wheel', 'continuous', axis='0 1 0'),
    joint('torso_fixed_joint', 'base_link', 'torso_fixed', 'fixed', axis='0 0 0'),
    joint('torso_lift_joint', 'torso_fixed', 'torso_lift', 'prismatic',
          extra='<limit lower="0" upper="0.35" effort="9" velocity="1"/>'),
    arm(TIAGO_JOINTS, 'torso_lift'),
    joint('gripper_left_finger_joint', 'arm_7_joint_link', 'finger', 'prismatic', axis='1 0 0'))

HUMANOID_ARM = tuple(f'right_{part}_joint' for part in (
    'shoulder_pitch', 'shoulder_roll', 'shoulder_yaw', 'elbow', 'wrist_roll'))
# A humanoid: a floating base, a waist that yaws and pitches, arms on the torso.
HUMANOID = robot(
    joint('floating_base_joint', 'world', 'base_link', 'floating', '0 0 0', axis=None),
    joint('waist_yaw_joint', 'base_link', 'waist', 'revolute', '0 0 0.1'),
    joint('waist_pitch_joint', 'waist', 'torso', 'revolute', '0 0 0.1', axis='0 1 0'),
    arm(HUMANOID_ARM, 'torso'),
    arm([name.replace('right', 'left') for name in HUMANOID_ARM], 'torso'),
    root='world').replace('<link name="base_link"/>', '')

SO101_JOINTS = ('shoulder_pan', 'shoulder_lift', 'elbow_flex', 'wrist_flex', 'wrist_roll',
                'gripper')
# SO-101: axes of fixed joints, and a revolute jaw.
SO101 = '\n ' + robot(arm(SO101_JOINTS, 'base_link'), joint(
    'gripper_frame_joint', 'wrist_roll_link', 'gripper_frame', 'fixed', axis='0 0 0'))
