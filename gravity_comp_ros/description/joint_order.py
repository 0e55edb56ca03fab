"""
Order of an arm's joints from the base outwards.

Drivers publish joints in any order, often alphabetically. The chain model requires the kinematic
order. It comes from, in this sequence:

- the robot description;
- the numbers in names that differ only in them, such as panda_joint1 to panda_joint7; a letter
  for shoulder, elbow or wrist may precede the number (left_s0 ... left_w2);
- the words for parts of an arm (elbow_joint, shoulder_lift_joint, wrist_1_joint).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import re

from gravity_comp_ros.errors import DataError, ModelMismatchError

DESCRIPTION = 'description'
NUMBERS = 'numbers in the names'
WORDS = 'words in the names'
AS_RECORDED = 'as recorded'
TORQUES = 'torques, which this order explains better than that of the recording'

_NUMBER = re.compile(r'(\d+)')
# A single letter before the number: shoulder, elbow, wrist.
_PART = re.compile(r'(?<![^\W_])([sSeEwW])(?=\d)')
_PARTS = 'sew'
_WORD = re.compile(r'[A-Z]?[a-z]+|[A-Z]+|\d+')
# Rank of the parts of an arm from the base outwards, and of the rotations within a part. The
# order of pitch, roll and yaw differs from robot to robot, so that these words are not used.
_PART_WORDS = {word: rank for rank, words in enumerate((
    'base waist torso', 'shoulder', 'upper upperarm', 'elbow', 'fore forearm lower lowerarm',
    'wrist', 'hand')) for word in words.split()}
_ROTATION_WORDS = {word: rank for rank, words in enumerate((
    'pan', 'lift', 'flex bend angle', 'roll rotate rotation twist')) for word in words.split()}
_IGNORED_WORDS = {'arm', 'joint'}


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
        from gravity_comp_ros.description.robot_tree import arm_joints
        try:
            joints, left_out = arm_joints(urdf, names)
        except (DataError, ModelMismatchError):
            pass
        else:
            if not left_out:
                return JointOrder(joints, DESCRIPTION)
    for ordered, source in ((_by_numbers, NUMBERS), (_by_words, WORDS)):
        result = ordered(names)
        if result is not None:
            return JointOrder(result, source)
    return JointOrder(tuple(names), AS_RECORDED)


def _by_words(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names sorted by the words for parts of an arm; None if these are ambiguous."""
    words = {name: [word.lower() for word in _WORD.findall(name)] for name in names}
    common = set.intersection(*map(set, words.values())) if words else set()
    keys = {name: _rank([word for word in own if word not in common | _IGNORED_WORDS])
            for name, own in words.items()}
    if len(names) < 2 or None in keys.values() or len(set(keys.values())) < len(names):
        return None
    return tuple(sorted(names, key=lambda name: keys[name] or ()))


def _rank(words: list[str]) -> tuple[int, int, int] | None:
    """Return part, rotation and number in the words of a name; None for an unknown word."""
    parts = [_PART_WORDS[word] for word in words if word in _PART_WORDS]
    rotations = [_ROTATION_WORDS[word] for word in words if word in _ROTATION_WORDS]
    numbers = [int(word) for word in words if word.isdigit()]
    if len(parts) != 1 or max(len(rotations), len(numbers)) > 1 or (
            len(words) > len(parts) + len(rotations) + len(numbers)):
        return None
    return parts[0], rotations[0] if rotations else -1, numbers[0] if numbers else -1


def _by_numbers(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names sorted by their numbers; None if these do not define an order."""
    keys = {name: _key(name) for name in names}
    templates = {template for template, _ in keys.values()}
    numbers = [key for _, key in keys.values()]
    if len(templates) != 1 or len(set(numbers)) < len(names) or len(names) < 2:
        return None
    # Two varying numbers (robot1_joint1 ... robot2_joint1) indicate two arms.
    counters = [column for column in zip(*(key[1:] for key in numbers)) if len(set(column)) > 1]
    if len(counters) > 1:
        return None
    return tuple(sorted(names, key=lambda name: keys[name][1]))


def _key(name: str) -> tuple[str, tuple[int, ...]]:
    """Return the name without its numbers, and the sort key: part of the arm, numbers."""
    letter = _PART.search(name)
    part = _PARTS.index(letter.group(1).lower()) if letter else -1
    template = _PART.sub('*', name) if letter else name
    numbers = tuple(int(number) for number in _NUMBER.findall(template))
    return _NUMBER.sub('#', template), (part, *numbers)
