"""
The order of an arm's joints, from the base outwards.

Drivers publish joints in any order, often by alphabet. The structure of a serial arm needs the
true one. A description has it. Otherwise numbers in the names have it, if the names are alike but
for their numbers, such as panda_joint1 to panda_joint7. Letters of shoulder, elbow and wrist
before the number count as well (left_s0 ... left_w2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import re

from gravity_comp_ros.errors import DataError, ModelMismatchError

DESCRIPTION = 'description'
NUMBERS = 'numbers in the names'
AS_RECORDED = 'as recorded'

_NUMBER = re.compile(r'(\d+)')
# A lone letter before the number: shoulder, elbow, wrist.
_PART = re.compile(r'(?<![^\W_])([sSeEwW])(?=\d)')
_PARTS = 'sew'


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
    return JointOrder(tuple(names), AS_RECORDED)


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
