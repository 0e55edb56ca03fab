"""All terms of the library, by the name of their effect."""

from __future__ import annotations

from gravity_comp_ros.terms import (
    elastic, friction, friction_memory, geometry, lubrication, offset, payload, periodic, timing)
from gravity_comp_ros.terms.effect import Effect

_FAMILIES = (friction, lubrication, friction_memory, offset, elastic, periodic, geometry, payload,
             timing)


def library_effects() -> dict[str, Effect]:
    """Return the effects of this package by name."""
    return {effect.name: effect for family in _FAMILIES for effect in family.EFFECTS}
