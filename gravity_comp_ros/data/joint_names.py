"""Joint names from user input: a name, or a number from 1."""

from __future__ import annotations

from collections.abc import Sequence


def joint_named(text: str, joints: Sequence[str]) -> str | None:
    """Return the joint with this name, else with this number, None if there is neither."""
    if text in joints:
        return text
    if text.isdecimal() and 1 <= int(text) <= len(joints):
        return joints[int(text) - 1]
    return None
