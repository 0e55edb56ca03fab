"""
Registry of effects by name: those of the library and of plug-ins.

A package adds effects by an entry point of the group `gravity_comp_ros.effects` that names a
class of `Effect`, an instance, or a list or tuple of them. A plug-in that cannot be loaded is
skipped, with one line in `broken_plug_ins`. A plug-in that fails on a motion is untestable there.

Users request effects by texts `NAME` and `NAME:JOINT`; similar names are suggested.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache, partial
from importlib.metadata import entry_points

from gravity_comp_ros.data.samples import joint_named
from gravity_comp_ros.effects import (
    changes, elastic, friction, friction_memory, offset, periodic, rigid_body, tool_force)
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.applied_effects import target
from gravity_comp_ros.printable import printable
import numpy as np

GROUP = 'gravity_comp_ros.effects'
_FAMILIES = (friction, friction_memory, offset, elastic, periodic, changes, tool_force, rigid_body)


def all_effects() -> dict[str, Effect]:
    """Return all effects by name: those of the library, then those of plug-ins."""
    return dict(_load()[0])


def library_effects() -> dict[str, Effect]:
    """Return the effects of this package by name, without plug-ins."""
    return {effect.name: effect for family in _FAMILIES for effect in family.EFFECTS}


def broken_plug_ins() -> tuple[str, ...]:
    """Return one line for each skipped plug-in, with the reason."""
    return _load()[1]


@cache
def _load() -> tuple[dict[str, Effect], tuple[str, ...]]:
    effects = library_effects()
    skipped = []
    for point in sorted(entry_points(group=GROUP), key=lambda p: (p.name, p.value)):
        where = f'effect plug-in {printable(point.name)} ({printable(point.value)})'
        try:
            added = _effects_of(point.load())
        # A plug-in can raise any error on import, or exit.
        except (Exception, SystemExit) as error:  # noqa: B902
            reason = printable(error) or type(error).__name__
            skipped.append(f'{where} is skipped: {reason}')
            continue
        for effect in added:
            if effect.name in effects:
                skipped.append(f'{where} is skipped: there is an effect {effect.name} already')
            else:
                effects[effect.name] = effect
    return effects, tuple(skipped)


def _effects_of(loaded: object) -> list[Effect]:
    """
    Return the guarded effects of an entry point: one, or a list or tuple of them.

    A class is instantiated.

    :raises OptionError: if it refers to another object, or an attribute of an effect is missing.
    """
    effects = []
    for entry in loaded if isinstance(loaded, (list, tuple)) else (loaded,):
        effect = entry() if isinstance(entry, type) and issubclass(entry, Effect) else entry
        if not isinstance(effect, Effect):
            raise OptionError(f'it is a {type(effect).__name__}, not an Effect')
        if not isinstance(effect.name, str) or not effect.name.isidentifier():
            raise OptionError(f'its name {effect.name!r} must consist of letters, digits and _')
        Effect.__init__(effect)  # its own may not check the attributes
        effects.append(guarded(effect))
    return effects


def guarded(effect: Effect) -> Effect:
    """Return an effect of another package, now untestable on motions on which its methods fail."""
    vars(effect)['untestable'] = partial(_untestable, effect)
    return effect


def _untestable(effect: Effect, motion: Motion, joint: int) -> str | None:
    """Return why a motion does not excite an effect, or the error of its methods."""
    try:
        return type(effect).untestable(effect, motion, joint) or _fault(effect, motion, joint)
    except Exception as error:  # noqa: B902
        return f'the plug-in of {effect.name} fails: {printable(error) or type(error).__name__}'


def _fault(effect: Effect, motion: Motion, joint: int) -> str | None:
    """Return the error in an effect's columns on a motion, or None."""
    m, n = motion.samples.q.shape
    for setting in effect.settings(motion, joint):
        columns = np.asarray(effect.columns(motion, joint, setting))
        k = len(effect.coefficients_of(motion, joint, setting))
        shape = (m, k) if effect.scope == 'joint' else (m, n, k)
        if columns.shape != shape or not np.isfinite(columns).all():
            return (f'the plug-in of {effect.name} fails: its columns are {columns.shape} and '
                    f'must be {shape}, and finite')
    return None


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
