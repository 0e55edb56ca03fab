"""
Checks of vectors of a few numbers, for what is done a thousand times a second.

Each call of numpy takes its microsecond, however short the vector is; Python itself looks at seven
numbers in less.
"""

from __future__ import annotations

import math

from gravity_comp_ros.data.samples import FloatArray
import numpy as np


def all_finite(values: FloatArray) -> bool:
    """Return whether no number of a vector is infinite or NaN."""
    return all(map(math.isfinite, values.tolist()))


class Bounds:
    """
    Bounds of the size of every number of a vector.

    :param most: the largest absolute values (N,), all positive.
    """

    def __init__(self, most: FloatArray) -> None:
        self._most = most
        self._tightest = float(most.min(initial=np.inf))

    def hold(self, values: FloatArray) -> bool:
        """Return whether a vector (N,) keeps every bound; one with NaN does not."""
        tightest = self._tightest
        for value in values.tolist():
            if not -tightest <= value <= tightest:
                return bool((np.abs(values) <= self._most).all())
        return True
