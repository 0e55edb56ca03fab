"""White noise of measured angles and speeds, from differences that remove smooth motion."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

from gravity_comp_ros.data.constants import MAD
from gravity_comp_ros.data.samples import BoolArray, FloatArray
import numpy as np

# Orders of the differences. Those of white noise have the same standard deviation once scaled,
# those of motion a smaller one the higher the order.
_ORDERS = (4, 6, 8)
# Maximum ratio of time steps in an evenly spaced window, and minimum share of such windows.
_MAX_STEP_RATIO = 1.2
_MIN_EVEN_SHARE = 0.05


def white_noise(runs: Sequence[tuple[FloatArray, FloatArray | None]]) -> FloatArray:
    """
    Return the standard deviation (...) of the white noise of values in several runs.

    It is the smallest of the estimates by several orders of differences. Their medians are robust
    to the start of motions. Slow noise is not included.

    :param runs: values (M, ...) and their times (M,) in s, to exclude differences over lost
        messages; without times they are evenly spaced.
    """
    smallest = np.full(runs[0][0].shape[1:], np.inf)
    for order in _ORDERS:
        parts = [_differences(values, t, order) for values, t in runs if len(values) > order]
        if sum(map(len, parts)):
            size = np.median(np.abs(np.concatenate(parts)), axis=0)
            # The variance of a difference is the sum of squared binomial coefficients.
            smallest = np.minimum(smallest, MAD * size / np.sqrt(comb(2 * order, order)))
    return np.asarray(np.where(np.isfinite(smallest), smallest, 0.0))


def _differences(values: FloatArray, t: FloatArray | None, order: int) -> FloatArray:
    differences = np.diff(values, n=order, axis=0)
    return differences if t is None else differences[evenly_spaced(t, order)]


def evenly_spaced(t: FloatArray, order: int) -> BoolArray:
    """Return a mask of the evenly spaced ones of M - order windows; all if few are."""
    steps = np.diff(t)
    if len(steps) < order:
        return np.zeros(0, dtype=bool)
    windows = [steps[k:len(steps) - order + k + 1] for k in range(order)]
    even = np.maximum.reduce(windows) <= _MAX_STEP_RATIO * np.minimum.reduce(windows)
    return np.asarray(even if even.mean() >= _MIN_EVEN_SHARE else np.ones(len(even), dtype=bool))
