"""Decimation of samples for plots that keeps all peaks."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, IntArray
import numpy as np

MAX_ROWS = 12_000


def keep_extremes(runs: IntArray, values: FloatArray,
                  max_rows: int = MAX_ROWS) -> tuple[IntArray, FloatArray]:
    """
    Return increasing sample indices, about `max_rows` of M, and the weight of each sample.

    Time is divided into intervals. The minimum and maximum of every column in each interval are
    kept, and so are the first and last samples of runs; equidistant samples fill the rest.
    Extremes have weight 1; the other weights sum to the number of remaining samples, so that
    weighted sums are unbiased.

    :param runs: the run of each sample (M,).
    :param values: the drawn values (M, K).
    """
    m, k = values.shape
    if m <= max_rows:
        return np.arange(m, dtype=np.int64), np.ones(m)
    intervals = max(1, max_rows // (4 * k))
    kept = [np.searchsorted(runs, np.unique(runs)),
            np.searchsorted(runs, np.unique(runs), side='right') - 1]
    edges = np.linspace(0, m, intervals + 1).astype(np.int64)
    for first, last in zip(edges[:-1], edges[1:]):
        part = values[first:last]
        kept += [first + part.argmin(axis=0), first + part.argmax(axis=0)]
    extremes = np.unique(np.concatenate(kept))
    filling = np.linspace(0, m - 1, max(max_rows - len(extremes), 2)).astype(np.int64)
    filling = np.setdiff1d(filling, extremes)
    rows = np.union1d(extremes, filling).astype(np.int64)
    weights = np.where(np.isin(rows, filling), (m - len(extremes)) / max(len(filling), 1), 1.0)
    return rows, weights
