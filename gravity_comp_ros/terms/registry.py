"""All terms of the library, by the name of their effect."""

from __future__ import annotations

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.terms import (
    elastic, friction, friction_memory, geometry, lubrication, offset, payload, periodic, timing)
from gravity_comp_ros.terms.effect import Effect

_FAMILIES = (friction, lubrication, friction_memory, offset, elastic, periodic, geometry, payload,
             timing)


def library_effects() -> dict[str, Effect]:
    """Return the effects of this package by name."""
    return {effect.name: effect for family in _FAMILIES for effect in family.EFFECTS}


def known_effect(name: str) -> Effect:
    """
    Return the effect of that name.

    :raises OptionError: if there is none.
    """
    known = library_effects()
    if name not in known:
        raise OptionError(f'no effect {name!r}; known are {", ".join(known)}')
    return known[name]
