"""The exception tree: every error that a user can cause derives from `GravityCompError`."""

from __future__ import annotations

from enum import Enum


class Hint(Enum):
    """
    A remedy for an error.

    The value is worded for the Python interface. The command line and the node word it in terms of
    their own options and services.
    """

    SLOW_MOTION = 'record slow motion, raise max_speed of the gate, or read with gate=None'
    IN_MODEL = 'undo() removes the last addition'
    NAME_DESCRIPTION = 'name a URDF file (urdf)'
    HELD_JOINT_MOVES = 'learn it as a joint of the arm, or give its position (fixed)'
    INSTALL_EFFECT = 'install the package that provides it, or remove it with undo()'


class GravityCompError(Exception):
    """
    Base of all errors of this package.

    The message is one line with the error and its place. `hint` is the remedy, where it depends on
    the interface in use; `str` of the error contains both.
    """

    def __init__(self, message: str = '', hint: Hint | None = None) -> None:
        super().__init__(message if hint is None else f'{message}: {hint.value}')
        self.message = message
        self.hint = hint

    def __reduce__(self) -> tuple[object, ...]:
        """Return the constructor call for unpickling in another process."""
        return type(self), (self.message, self.hint)


class OptionError(GravityCompError, ValueError):
    """An option or parameter with an invalid value."""


class DataError(GravityCompError, ValueError):
    """Unusable samples: wrong shape, not finite, too few, not moving."""


class BagError(GravityCompError):
    """A bag or table that cannot be read or written."""


class ModelFileError(GravityCompError):
    """A model file that is missing, damaged, of another version, or cannot be written."""


class ModelMismatchError(GravityCompError):
    """Data and model, or data and data, that belong to different robots."""


class FitError(GravityCompError):
    """A fit without a usable result."""
