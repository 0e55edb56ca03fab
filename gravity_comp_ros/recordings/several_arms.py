"""Recordings of more than one arm: by the names of their joints, by turns, or by jumps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import re

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

# Words that tell sides apart, so that few joints in common are enough.
_SIDES = ('left', 'right', 'l', 'r')
_FEW, _MANY, _MOST = 2, 4, 0.6
# Positions that jump by more than this, rad, and are back with the next message.
_JUMP, _BACK = 0.05, 0.2


def arms_by_name(names: Sequence[str]) -> list[tuple[str, ...]]:
    """
    Return the joints of each arm, none or at least two, that differ in one word of their names.

    `left_shoulder left_elbow right_shoulder right_elbow` are two arms. The word comes at the
    same place in every name, from its beginning or its end; two arms have two other names in
    common if it is a side, else four. Fingers of a gripper have sides too: arms are most of the
    joints.
    """
    words = {name: re.split(r'[_/.\s-]+', name) for name in names}
    best: list[tuple[str, ...]] = []
    shortest = min((len(parts) for parts in words.values()), default=0)
    for place in range(-shortest, shortest):
        groups: dict[str, dict[tuple[str, ...], str]] = {}
        for name, parts in words.items():
            rest = tuple(part for k, part in enumerate(parts) if k != place % len(parts))
            groups.setdefault(parts[place].lower(), {})[rest] = name
        arms = _alike(groups)
        if sum(map(len, arms)) > sum(map(len, best)):
            best = arms
    return best if sum(map(len, best)) > _MOST * len(names) else []


def _alike(groups: dict[str, dict[tuple[str, ...], str]]) -> list[tuple[str, ...]]:
    """Return the groups that have enough names in common with another one."""
    found = []
    for word, names in groups.items():
        for other, others in groups.items():
            least = _FEW if {word, other} <= set(_SIDES) else _MANY
            if word != other and len(names.keys() & others.keys()) >= least:
                found.append(tuple(names.values()))
                break
    return found


def arms_by_turns(layouts: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return joints that take turns on one topic: sets of at least two, none in common."""
    found: list[tuple[str, ...]] = []
    for names in sorted(layouts, key=len, reverse=True):
        if len(names) >= _FEW and all(not set(names) & set(other) for other in found):
            found.append(names)
    return found if len(found) > 1 else []


def jumps_to_and_fro(q: FloatArray) -> bool:
    """
    Return whether positions (M, N) in rad alternate between two places, message by message.

    Two robots that publish the same joint names on one topic look like that.
    """
    if len(q) < 20:
        return False
    for joint in q.T:
        step = np.median(np.abs(np.diff(joint)))
        if step > _JUMP and np.median(np.abs(joint[2:] - joint[:-2])) < _BACK * step:
            return True
    return False
