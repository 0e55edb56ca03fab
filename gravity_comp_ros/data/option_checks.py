"""Checks of options on construction."""

from __future__ import annotations

from gravity_comp_ros.errors import OptionError
import numpy as np


def check_positive(options: object, what: str, *names: str) -> None:
    """
    Check that numbers of a dataclass of options, or of its tuples, are positive and finite.

    :param what: subject of the message.
    :param names: of the numbers; all by default.
    :raises OptionError: if one is not, with its name and value.
    """
    for name in names or vars(options):
        value = getattr(options, name)
        numbers = np.asarray(value, dtype=np.float64)
        if not (numbers.size and ((numbers > 0.0) & (numbers < np.inf)).all()):
            raise OptionError(f'{what}: {name} is {value}; it must be positive')
