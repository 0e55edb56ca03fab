"""
Order of an arm's joints from the base outwards.

Drivers publish joints in any order, often alphabetically. The chain model requires the kinematic
order. It comes from, in this sequence:

- the robot description;
- numbers and words for parts of an arm in the names: panda_joint1 to panda_joint7, left_s0 to
  left_w2 (shoulder, elbow, wrist), elbow_joint, shoulder_lift_joint, wrist_1_joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import re

from gravity_comp_ros.errors import DataError, ModelMismatchError

DESCRIPTION = 'description'
NAMES = 'numbers and words in the names'
AS_RECORDED = 'as recorded'
TORQUES = 'torques, which this order explains better than that of the recording'

_WORD = re.compile(r'[A-Z]?[a-z]+|[A-Z]+|\d+')
# Rank of the parts of an arm from the base outwards, and of the rotations within a part. The
# order of pitch, roll and yaw differs from robot to robot, so that these words are not used.
_PARTS = {word: rank for rank, words in enumerate((
    'base waist torso', 's shoulder', 'upper upperarm', 'e elbow', 'fore forearm lower lowerarm',
    'w wrist', 'hand')) for word in words.split()}
_ROTATIONS = {word: rank for rank, words in enumerate((
    'pan', 'lift', 'flex bend angle', 'roll rotate rotation twist')) for word in words.split()}
_IGNORED = {'arm', 'joint'}


@dataclass(frozen=True)
class JointOrder:
    """Joints from the base outwards, and the source of this order."""

    joints: tuple[str, ...]
    source: str


def joint_order(names: Sequence[str], urdf: str | bytes | None = None) -> JointOrder:
    """
    Return the names in the order of the arm, and the source of the order.

    A description is used only if all the names are on one path of it.

    :param names: joints as recorded.
    :param urdf: text of the robot description.
    """
    if urdf is not None:
        from gravity_comp_ros.description.robot_tree import parse_tree
        try:
            joints, left_out = parse_tree(urdf).arm_joints(names)
        except (DataError, ModelMismatchError):
            pass
        else:
            if not left_out:
                return JointOrder(joints, DESCRIPTION)
    result = _by_names(names)
    return JointOrder(tuple(names), AS_RECORDED) if result is None else JointOrder(result, NAMES)


def _by_names(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names sorted by their words and numbers; None if these define no order."""
    words = [[word.lower() for word in _WORD.findall(name)] for name in names]
    numbers = [tuple(int(word) for word in own if word.isdigit()) for own in words]
    if len(set(map(len, numbers))) == 1:
        # A number that all names share is that of the robot.
        varying = [column for column in zip(*numbers) if len(set(column)) > 1]
        numbers = list(zip(*varying)) or [()] * len(names)
    common = set.intersection(*map(set, words)) if words else set()
    keys = [_key([word for word in own if word not in common | _IGNORED], number)
            for own, number in zip(words, numbers)]
    ranks = [key for key in keys if key is not None]
    if len(names) < 2 or len(set(ranks)) < len(names) or len({len(key) for key in ranks}) > 1:
        return None
    return tuple(name for _, name in sorted(zip(ranks, names)))


def _key(words: list[str], numbers: tuple[int, ...]) -> tuple[int, ...] | None:
    """Return part, rotation and number of a name, or the number alone; None if it is ambiguous."""
    parts = [_PARTS[word] for word in words if word in _PARTS]
    rotations = [_ROTATIONS[word] for word in words if word in _ROTATIONS]
    others = len(words) - len(parts) - len(rotations) - sum(map(str.isdigit, words))
    if others or max(map(len, (parts, rotations, numbers))) > 1:
        return None
    if parts:
        return parts[0], *(rotations or [-1]), *(numbers or [-1])
    return numbers if numbers and not rotations else None
