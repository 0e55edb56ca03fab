"""The exception tree: every error that a user can cause derives from `GravityCompError`."""

from __future__ import annotations

from enum import Enum


class Hint(Enum):
    """
    What may help against an error.

    The value says it to somebody who writes Python. The command line and the node say the same
    in terms of their own options and services.
    """

    SLOW_MOTION = 'record slow motion, raise max_speed of the gate, or read with gate=None'
    IN_MODEL = 'undo() takes back what was added last'
    NAME_DESCRIPTION = 'name a URDF file (urdf)'
    HELD_JOINT_MOVES = 'learn it as a joint of the arm, or say where it stands (fixed)'
    INSTALL_EFFECT = 'install the package that brings it, or take it back with undo()'


class GravityCompError(Exception):
    """
    Base of all errors of this package.

    The message is one line that says what was wrong and where. `hint` says what to do about
    it, where that depends on how the package is used; `str` of the error holds both.
    """

    def __init__(self, message: str = '', hint: Hint | None = None) -> None:
        super().__init__(message if hint is None else f'{message}: {hint.value}')
        self.message = message
        self.hint = hint

    def __reduce__(self) -> tuple[object, ...]:
        """Return what makes an equal error in another process."""
        return type(self), (self.message, self.hint)


class OptionError(GravityCompError, ValueError):
    """An option or parameter has a value that makes no sense."""


class DataError(GravityCompError, ValueError):
    """Samples that cannot be used: wrong shape, not finite, too few, not moving."""


class BagError(GravityCompError):
    """A bag or table that cannot be read or written."""


class ModelFileError(GravityCompError):
    """A model file that is missing, damaged, of another version, or cannot be written."""


class ModelMismatchError(GravityCompError):
    """Data and model, or data and data, that belong to different robots."""


class FitError(GravityCompError):
    """A fit that has no usable result."""
