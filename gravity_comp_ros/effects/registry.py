"""
All effects by name: our own, and those that other packages bring.

A package adds effects by an entry point of the group `gravity_comp_ros.effects` that names a
class of `Effect`, an object of one, or a list or tuple of them. What cannot be loaded is left out
with one line in `broken_plug_ins`; what fails later, on a motion, is untestable there.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points

from gravity_comp_ros.effects import (
    dynamics, elastic, friction, friction_memory, geometry, lubrication, offset, payload, periodic,
    rigid_body, timing)
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.entry_points import effects_of
from gravity_comp_ros.printable import printable

GROUP = 'gravity_comp_ros.effects'
_FAMILIES = (friction, lubrication, friction_memory, offset, elastic, periodic, geometry, payload,
             dynamics, rigid_body, timing)


def all_effects() -> dict[str, Effect]:
    """Return every effect by its name: the library's in its order, then the plug-ins'."""
    return dict(_load()[0])


def library_effects() -> dict[str, Effect]:
    """Return the effects of this package by name, without those of plug-ins."""
    return {effect.name: effect for family in _FAMILIES for effect in family.EFFECTS}


def broken_plug_ins() -> tuple[str, ...]:
    """Return one line for each plug-in that was left out, saying which and why."""
    return _load()[1]


@cache
def _load() -> tuple[dict[str, Effect], tuple[str, ...]]:
    effects = library_effects()
    complaints = []
    for point in sorted(entry_points(group=GROUP), key=lambda p: (p.name, p.value)):
        where = f'effect plug-in {printable(point.name)} ({printable(point.value)})'
        try:
            added = effects_of(point.load())
        # Whatever a stranger's module raises on import, or that it exits, is its own affair.
        except (Exception, SystemExit) as error:  # noqa: B902
            reason = printable(error) or type(error).__name__
            complaints.append(f'{where} is left out: {reason}')
            continue
        for effect in added:
            if effect.name in effects:
                complaints.append(f'{where} is left out: there is an effect {effect.name} already')
            else:
                effects[effect.name] = effect
    return effects, tuple(complaints)
