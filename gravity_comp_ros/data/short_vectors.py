"""
Fast checks of vectors of a few numbers, for loops at 1 kHz.

A numpy call takes about a microsecond even for a short vector; a Python loop over seven numbers
takes less.
"""

from __future__ import annotations

import math

from gravity_comp_ros.data.samples import FloatArray
import numpy as np


def all_finite(values: FloatArray) -> bool:
    """Return whether all numbers of a vector are finite."""
    return all(map(math.isfinite, values.tolist()))


class Bounds:
    """
    Symmetric bounds of every number of a vector.

    :param maxima: the maximum absolute values (N,), all positive.
    """

    def __init__(self, maxima: FloatArray) -> None:
        self._maxima = maxima
        self._tightest = float(maxima.min(initial=np.inf))

    def contain(self, values: FloatArray) -> bool:
        """Return whether a vector (N,) is within all bounds, which NaN is not."""
        tightest = self._tightest
        for value in values.tolist():
            if not -tightest <= value <= tightest:
                return bool((np.abs(values) <= self._maxima).all())
        return True
