"""Fewer samples to draw, without losing a peak."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, IntArray
import numpy as np

MOST_ROWS = 4000


def keep_extremes(runs: IntArray, values: FloatArray,
                  most: int = MOST_ROWS) -> tuple[IntArray, FloatArray]:
    """
    Return rising sample numbers, about `most` of M, and how many samples each one stands for.

    Time is cut into stretches; of each the smallest and the largest sample of every column
    stay, so that a peak of a single sample is drawn however long the recording. First and last
    samples of runs stay as well, and samples at even distances fill the rest. Extremes stand for
    themselves and the others for what is not drawn, so that sums with these weights have no bias.

    :param runs: the run of each sample (M,).
    :param values: what is drawn, (M, K).
    """
    m, k = values.shape
    if m <= most:
        return np.arange(m, dtype=np.int64), np.ones(m)
    stretches = max(1, most // (4 * k))
    kept = [np.searchsorted(runs, np.unique(runs)),
            np.searchsorted(runs, np.unique(runs), side='right') - 1]
    edges = np.linspace(0, m, stretches + 1).astype(np.int64)
    for first, last in zip(edges[:-1], edges[1:]):
        part = values[first:last]
        kept += [first + part.argmin(axis=0), first + part.argmax(axis=0)]
    extremes = np.unique(np.concatenate(kept))
    filling = np.linspace(0, m - 1, max(most - len(extremes), 2)).astype(np.int64)
    filling = np.setdiff1d(filling, extremes)
    rows = np.union1d(extremes, filling).astype(np.int64)
    weights = np.where(np.isin(rows, filling), (m - len(extremes)) / max(len(filling), 1), 1.0)
    return rows, weights
