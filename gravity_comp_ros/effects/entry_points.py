"""Effects from strangers: an effect that fails must not take the tool with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gravity_comp_ros.effects.effect import Effect, Motion, Setting
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.printable import printable
import numpy as np


def effects_of(loaded: object) -> tuple[Effect, ...]:
    """
    Return the effects that an entry point names: one, or a list or tuple of them.

    :raises OptionError: if it names something else.
    """
    found = loaded if isinstance(loaded, (list, tuple)) else (loaded,)
    for effect in found:
        if not isinstance(effect, Effect):
            raise OptionError(f'it names a {type(effect).__name__}, not an Effect')
        if not isinstance(effect.name, str) or not effect.name.isidentifier():
            raise OptionError(f'its name {effect.name!r} must be letters, digits and _')
    return tuple(found)


def guarded(effect: Effect) -> Effect:
    """Return the effect, but untestable on motions on which its own functions fail."""
    def untestable(motion: Motion, joint: int) -> str | None:
        try:
            reason = effect.untestable(motion, joint)
            return reason if reason else _trial(effect, motion, joint)
        except Exception as error:  # noqa: B902
            words = printable(error) or type(error).__name__
            return f'the plug-in that brings {effect.name} fails: {words}'
    return replace(effect, untestable=untestable)


def _trial(effect: Effect, motion: Motion, joint: int) -> str | None:
    """Return what is wrong with an effect's columns on a motion, or None."""
    m, n = motion.samples.q.shape
    settings: Sequence[Setting] = effect.settings(motion, joint)
    for setting in settings:
        columns = np.asarray(effect.columns(motion, joint, setting))
        k = len(effect.coefficients_of(motion, joint, setting))
        shape = (m, k) if effect.scope == 'joint' else (m, n, k)
        if columns.shape != shape or not np.isfinite(columns).all():
            return (f'the plug-in that brings {effect.name} fails: its columns are '
                    f'{columns.shape} and must be {shape}, and finite')
    return None
