"""Effects of other packages, isolated so that their errors do not stop a diagnosis."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import ATTRIBUTES, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.printable import printable
import numpy as np


def effects_of(loaded: object) -> tuple[Effect, ...]:
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
        effects.append(GuardedEffect(effect))
    return tuple(effects)


class GuardedEffect(Effect):
    """An effect of another package, untestable on motions on which its methods fail."""

    def __init__(self, effect: Effect) -> None:
        self.effect = effect
        # Everything except `columns` and `untestable` is that of the effect.
        vars(self).update({name: getattr(effect, name) for name in (
            *ATTRIBUTES, 'settings', 'refine', 'coefficients_of', 'prior_std',
            'implausible')})
        super().__init__()

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return self.effect.columns(motion, joint, setting)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        try:
            return self.effect.untestable(motion, joint) or _fault(self.effect, motion, joint)
        except Exception as error:  # noqa: B902
            message = printable(error) or type(error).__name__
            return f'the plug-in of {self.name} fails: {message}'


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
