"""Detection of several arms in a recording, from joint names and messages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import re

_SIDES = ('left', 'right', 'l', 'r')
# Minimum number of joint names shared by two arms, for sides and for other words.
_MIN_SHARED_SIDES, _MIN_SHARED = 2, 4
# Minimum share of all joints that belong to arms.
_MIN_SHARE = 0.6


def arms_by_name(names: Sequence[str]) -> list[tuple[str, ...]]:
    """
    Return the joints of each arm if arms differ in one word of the joint names, else none.

    `left_shoulder left_elbow right_shoulder right_elbow` are two arms. The word has the same
    position in all names, counted from the beginning or the end. Two arms share at least two of
    the remaining names if the word is a side, else four. Because fingers of a gripper have sides
    too, the arms must include most of the joints.
    """
    words = {name: re.split(r'[_/.\s-]+', name) for name in names}
    best: list[tuple[str, ...]] = []
    n_words = min((len(parts) for parts in words.values()), default=0)
    for position in range(-n_words, n_words):
        groups: dict[str, dict[tuple[str, ...], str]] = {}
        for name, parts in words.items():
            rest = tuple(part for k, part in enumerate(parts) if k != position % len(parts))
            groups.setdefault(parts[position].lower(), {})[rest] = name
        arms = _with_shared_names(groups)
        if sum(map(len, arms)) > sum(map(len, best)):
            best = arms
    return best if sum(map(len, best)) > _MIN_SHARE * len(names) else []


def _with_shared_names(groups: dict[str, dict[tuple[str, ...], str]]) -> list[tuple[str, ...]]:
    """Return the groups that share enough names with another group."""
    def similar(word: str, other: str) -> bool:
        minimum = _MIN_SHARED_SIDES if {word, other} <= set(_SIDES) else _MIN_SHARED
        return word != other and len(groups[word].keys() & groups[other].keys()) >= minimum

    return [tuple(names.values()) for word, names in groups.items()
            if any(similar(word, other) for other in groups)]


def arms_by_message(layouts: Iterable[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return arms published in separate messages: disjoint sets of at least two joints."""
    arms: list[tuple[str, ...]] = []
    for names in sorted(layouts, key=len, reverse=True):
        if len(names) >= 2 and all(not set(names) & set(other) for other in arms):
            arms.append(names)
    return arms if len(arms) > 1 else []
