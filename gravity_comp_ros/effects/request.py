"""What `NAME` or `NAME:JOINT` asks for, with a word on what was probably meant."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import SequenceMatcher

from gravity_comp_ros.data.joint_names import joint_named
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.printable import printable

_ALIKE = 0.6


@dataclass(frozen=True)
class Request:
    """
    One effect on one joint (None: the whole arm).

    `named` says that the joint was named; without a joint an effect is asked for on every
    joint, and left out where it cannot be seen.
    """

    effect: Effect
    joint: str | None
    named: bool

    @property
    def target(self) -> str:
        return target(self.effect.name, self.joint)


def requests(texts: Iterable[str], joints: tuple[str, ...]) -> list[Request]:
    """
    Return what texts like `coulomb_friction:elbow` ask for on an arm of these joints.

    A joint is named by its name, or by its number from 1.

    :raises OptionError: if an effect or joint is unknown, or is asked for twice.
    """
    found: list[Request] = []
    for text in texts:
        found += _parse(text.strip(), joints)
    targets = [request.target for request in found]
    twice = sorted({name for name in targets if targets.count(name) > 1})
    if twice:
        raise OptionError(f'{printable(", ".join(twice))} is asked for twice')
    return found


def known_effect(name: str) -> Effect:
    """
    Return the effect of that name.

    :raises OptionError: if there is none; the message says what was probably meant.
    """
    known = all_effects()
    if name not in known:
        raise OptionError(f'no effect {printable(name)!r}{_meant(name, known)}; known are '
                          f'{", ".join(known)}')
    return known[name]


def _parse(text: str, joints: tuple[str, ...]) -> list[Request]:
    name, colon, joint = text.partition(':')
    effect = known_effect(name)
    if not effect.per_joint:
        if colon:
            raise OptionError(f'{name} is about the whole arm: give it without a joint')
        return [Request(effect, None, True)]
    if not colon:
        return [Request(effect, each, False) for each in joints]
    named = joint_named(joint, joints)
    if named is None:
        raise OptionError(f'no joint {printable(joint)!r} in the model{_meant(joint, joints)}; '
                          f'it has {", ".join(joints)}, or 1 to {len(joints)}')
    return [Request(effect, named, True)]


def _meant(word: str, known: Iterable[str]) -> str:
    def likeness(name: str) -> float:
        # What was typed may be only the beginning of a name.
        return max(SequenceMatcher(None, word, part).ratio()
                   for part in (name, name[:len(word) + 1]))

    closest = max(known, key=likeness, default=None)
    if closest is None or likeness(closest) < _ALIKE:
        return ''
    return f' (did you mean {closest}?)'
