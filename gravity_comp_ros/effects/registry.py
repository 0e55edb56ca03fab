"""
Registry of effects by name: those of the library and of plug-ins.

A package adds effects by an entry point of the group `gravity_comp_ros.effects` that names a
class of `Effect`, an instance, or a list or tuple of them. A plug-in that cannot be loaded is
skipped, with one line in `broken_plug_ins`. A plug-in that fails on a motion is untestable there.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points

from gravity_comp_ros.effects import (
    elastic, friction, friction_memory, geometry, lubrication, offset, payload, periodic,
    rigid_body, timing)
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.entry_points import effects_of
from gravity_comp_ros.printable import printable

GROUP = 'gravity_comp_ros.effects'
_FAMILIES = (friction, lubrication, friction_memory, offset, elastic, periodic, geometry, payload,
             rigid_body, timing)


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
            added = effects_of(point.load())
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
