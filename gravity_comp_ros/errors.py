"""The exception tree: every error that a user can cause derives from `GravityCompError`."""


class GravityCompError(Exception):
    """
    Base of all errors of this package.

    The message is one line that says what was wrong, where, and what to do about it. The
    command line prints it and exits 1; the node answers a service call with it.
    """


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
