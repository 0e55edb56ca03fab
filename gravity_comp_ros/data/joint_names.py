"""Joint names: from user input, as a name or a number from 1, and of other recordings."""

from __future__ import annotations

from collections.abc import Sequence
from os.path import commonprefix
import re


def joint_named(text: str, joints: Sequence[str]) -> str | None:
    """Return the joint with this name, else with this number, None if there is neither."""
    if text in joints:
        return text
    if text.isdecimal() and 1 <= int(text) <= len(joints):
        return joints[int(text) - 1]
    return None


def rename_hint(known: Sequence[str], wanted: Sequence[str]) -> str:
    """
    Return the `--rename` that maps recorded names to wanted ones, '' if the names do not tell.

    Names correspond if they are equal without what all of them have in common at the beginning
    and at the end, as prefixes of a robot.
    """
    pairs = _by_ending(known, wanted) or _by_core(known, wanted)
    if not pairs or len(set(pairs.values())) < len(wanted):
        return ''
    return '; if these are the same joints: --rename ' + ','.join(
        f'{old}={new}' for new, old in pairs.items() if old != new)


def _by_ending(known: Sequence[str], wanted: Sequence[str]) -> dict[str, str]:
    """Return known names by the wanted ones, of which one ends with the other."""
    pairs = {}
    for new in wanted:
        matches = [old for old in known if _plain(old).endswith(_plain(new))
                   or _plain(new).endswith(_plain(old))]
        if len(matches) != 1:
            return {}
        pairs[new] = matches[0]
    return pairs


def _by_core(known: Sequence[str], wanted: Sequence[str]) -> dict[str, str]:
    """Return known names by the wanted ones, without common beginning and end."""
    cores = dict(zip(_cores(known), known))
    pairs = {new: cores[core] for new, core in zip(wanted, _cores(wanted)) if core in cores}
    return pairs if len(pairs) == len(wanted) and len(cores) == len(known) else {}


def _cores(names: Sequence[str]) -> list[str]:
    plain = [_plain(name) for name in names]
    first = len(commonprefix(plain))
    last = len(commonprefix([name[::-1] for name in plain]))
    return [name[first:len(name) - last] for name in plain]


def _plain(name: str) -> str:
    return re.sub(r'[\W_]', '', name).lower()
