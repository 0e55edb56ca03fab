"""The exception tree: every error that a user can cause derives from `GravityCompError`."""

from __future__ import annotations


class GravityCompError(Exception):
    """
    Base of all errors of this package.

    The message is one line with the error, its place, and a remedy.
    """


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
