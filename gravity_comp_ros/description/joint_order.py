"""
The order of an arm's joints, from the base outwards.

Drivers publish joints in any order, often by alphabet. The structure of a serial arm needs the
true one. A description has it. Otherwise numbers in the names have it, if the names are alike but
for their numbers, such as panda_joint1 to panda_joint7. Letters of shoulder, elbow and wrist
before the number count as well (left_s0 ... left_w2), and so do the words for the parts of an arm
(elbow_joint, shoulder_lift_joint, wrist_1_joint).
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
# A lone letter before the number: shoulder, elbow, wrist.
_PART = re.compile(r'(?<![^\W_])([sSeEwW])(?=\d)')
_PARTS = 'sew'
_WORD = re.compile(r'[A-Z]?[a-z]+|[A-Z]+|\d+')
# Parts of an arm from the base outwards, and what turns first where a part has several joints.
# Pitch, roll and yaw of one part come in another order on each robot, and say nothing.
_PART_WORDS = {word: place for place, words in enumerate((
    'base waist torso', 'shoulder', 'upper upperarm', 'elbow', 'fore forearm lower lowerarm',
    'wrist', 'hand')) for word in words.split()}
_TURN_WORDS = {word: place for place, words in enumerate((
    'pan', 'lift', 'flex bend angle', 'roll rotate rotation twist')) for word in words.split()}
_IDLE_WORDS = {'arm', 'joint'}


@dataclass(frozen=True)
class JointOrder:
    """Joints from the base outwards as far as `source` can say."""

    joints: tuple[str, ...]
    source: str


def joint_order(names: Sequence[str], urdf: str | bytes | None = None) -> JointOrder:
    """
    Return the names in the order of the arm, and what says so.

    A description that does not have all the names on one path is of no use here.

    :param names: joints as recorded.
    :param urdf: text of the robot's description.
    """
    if urdf is not None:
        from gravity_comp_ros.description.serial_arm import arm_joints
        try:
            found = arm_joints(urdf, names)
        except (DataError, ModelMismatchError):
            pass
        else:
            if not found.left_out:
                return JointOrder(found.joints, DESCRIPTION)
    numbered = _by_numbers(names)
    if numbered is not None:
        return JointOrder(numbered, NUMBERS)
    named = _by_words(names)
    if named is not None:
        return JointOrder(named, WORDS)
    return JointOrder(tuple(names), AS_RECORDED)


def _by_words(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names sorted by the parts of an arm in them; None if they do not say."""
    words = {name: [word.lower() for word in _WORD.findall(name)] for name in names}
    everywhere = set.intersection(*map(set, words.values())) if words else set()
    keys = {name: _place([word for word in found if word not in everywhere | _IDLE_WORDS])
            for name, found in words.items()}
    if len(names) < 2 or None in keys.values() or len(set(keys.values())) < len(names):
        return None
    return tuple(sorted(names, key=lambda name: keys[name] or ()))


def _place(words: list[str]) -> tuple[int, int, int] | None:
    """Return part, turn and number in the words of a name; None if a word is none of these."""
    parts = [_PART_WORDS[word] for word in words if word in _PART_WORDS]
    turns = [_TURN_WORDS[word] for word in words if word in _TURN_WORDS]
    numbers = [int(word) for word in words if word.isdigit()]
    if len(parts) != 1 or max(len(turns), len(numbers)) > 1 or (
            len(words) > len(parts) + len(turns) + len(numbers)):
        return None
    return parts[0], turns[0] if turns else -1, numbers[0] if numbers else -1


def _by_numbers(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return the names sorted by their numbers; None if the numbers do not order them."""
    keys = {name: _key(name) for name in names}
    templates = {template for template, _ in keys.values()}
    numbers = [key for _, key in keys.values()]
    if len(templates) != 1 or len(set(numbers)) < len(names) or len(names) < 2:
        return None
    # Two counters at a time (robot1_joint1 ... robot2_joint1) are two arms, not an order.
    counters = [column for column in zip(*(key[1:] for key in numbers)) if len(set(column)) > 1]
    if len(counters) > 1:
        return None
    return tuple(sorted(names, key=lambda name: keys[name][1]))


def _key(name: str) -> tuple[str, tuple[int, ...]]:
    """Return a name without its numbers, and its part of the arm followed by its numbers."""
    letter = _PART.search(name)
    part = _PARTS.index(letter.group(1).lower()) if letter else -1
    template = _PART.sub('*', name) if letter else name
    numbers = tuple(int(number) for number in _NUMBER.findall(template))
    return _NUMBER.sub('#', template), (part, *numbers)
