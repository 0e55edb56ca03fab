"""Parser of effect requests `NAME` and `NAME:JOINT`, with suggestions for misspelt names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches

from gravity_comp_ros.data.joint_names import joint_named
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.printable import printable


@dataclass(frozen=True)
class Request:
    """
    One effect on one joint (None: the whole arm).

    `named` is True if the joint was named. Otherwise the effect is requested on every joint and
    skipped where it is untestable.
    """

    effect: Effect
    joint: str | None
    named: bool

    @property
    def target(self) -> str:
        return target(self.effect.name, self.joint)


def requests(texts: Iterable[str], joints: tuple[str, ...]) -> list[Request]:
    """
    Return the requests of texts such as `coulomb_friction:elbow` for an arm with these joints.

    A joint is given by its name, or by its number from 1.

    :raises OptionError: if an effect or joint is unknown, or is requested twice.
    """
    parsed: list[Request] = []
    for text in texts:
        parsed += _parse(text.strip(), joints)
    targets = [request.target for request in parsed]
    twice = sorted({name for name in targets if targets.count(name) > 1})
    if twice:
        raise OptionError(f'{printable(", ".join(twice))} is requested twice')
    return parsed


def known_effect(name: str) -> Effect:
    """
    Return the effect of that name.

    :raises OptionError: if there is none; the message suggests a similar name.
    """
    known = all_effects()
    if name not in known:
        raise OptionError(f'no effect {printable(name)!r}{_suggestion(name, known)}; known are '
                          f'{", ".join(known)}')
    return known[name]


def _parse(text: str, joints: tuple[str, ...]) -> list[Request]:
    name, colon, joint = text.partition(':')
    effect = known_effect(name)
    if not effect.per_joint:
        if colon:
            raise OptionError(f'{name} acts on the whole arm: give it without a joint')
        return [Request(effect, None, True)]
    if not colon:
        return [Request(effect, each, False) for each in joints]
    named = joint_named(joint, joints)
    if named is None:
        raise OptionError(f'no joint {printable(joint)!r} in the model'
                          f'{_suggestion(joint, joints)}; it has {", ".join(joints)}, or 1 to '
                          f'{len(joints)}')
    return [Request(effect, named, True)]


def _suggestion(word: str, known: Iterable[str]) -> str:
    # The word may be an abbreviation of a name.
    whole = {part: name for name in known for part in (name, name[:len(word) + 1])}
    closest = get_close_matches(word, whole, 1)
    return f' (did you mean {whole[closest[0]]}?)' if closest else ''
