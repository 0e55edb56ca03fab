"""
Blocks of time as independent observations, and folds of blocks for cross-validation.

Residuals are autocorrelated: the effective sample size of 10 000 samples at 100 Hz may be 130. A
block of ten correlation times is nearly independent of the next, so tests and intervals count
blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.noise import correlation_time
import numpy as np

# Length of a block, in correlation times.
_CORRELATION_TIMES = 10.0
N_FOLDS = 5
_MIN_BLOCKS, _MAX_BLOCKS = 15, 120
# Minimum number of runs for which a fold is a stretch of each run: with fewer, the poses of a
# stretch may be missing from the other runs.
_MIN_RUNS_FOR_STRETCHES = 3
# Minimum number of clusters of blocks.
_MIN_CLUSTERS = 5


@dataclass(frozen=True, eq=False)
class Blocks:
    """
    M samples cut into B blocks, each within one run, and the blocks put into folds.

    `starts` (B + 1,) are the sample numbers at which blocks begin, and M; `run` (B,) is the run
    and `fold` (B,) the fold of each block; a fold is held out as a whole.
    """

    starts: IntArray
    run: IntArray
    fold: IntArray

    @property
    def count(self) -> int:
        return len(self.run)

    @property
    def n_folds(self) -> int:
        return int(self.fold.max()) + 1

    @property
    def clusters(self) -> IntArray:
        """
        Return the cluster of each block (B,), from 0: its run, or a stretch of it if runs are few.

        Unmodelled torque may bias a coefficient equally in all blocks of one motion, and
        differently in another run.
        """
        runs = np.unique(self.run, return_inverse=True)[1]
        n_runs = int(runs.max()) + 1
        parts = -(-_MIN_CLUSTERS // n_runs)
        cluster = np.empty(self.count, dtype=np.int64)
        for run in range(n_runs):
            blocks = np.flatnonzero(runs == run)
            cluster[blocks] = run * parts + np.arange(len(blocks)) * parts // len(blocks)
        return np.unique(cluster, return_inverse=True)[1].astype(np.int64)

    @cached_property
    def by_fold(self) -> tuple[IntArray, tuple[slice, ...]]:
        """Return the samples (M,) in the order of their folds, and the slice of each fold."""
        lengths = np.diff(self.starts)
        order = np.argsort(np.repeat(self.fold, lengths), kind='stable')
        ends = np.cumsum([0, *(lengths[self.fold == f].sum() for f in range(self.n_folds))])
        return order, tuple(slice(int(a), int(b)) for a, b in zip(ends, ends[1:]))

    def sums(self, values: FloatArray) -> FloatArray:
        """Return the sum of `values` (M, ...) over each block."""
        return np.add.reduceat(values, self.starts[:-1], axis=0)


def cut(samples: JointSamples, residual: FloatArray) -> Blocks:
    """
    Cut samples into blocks of ten correlation times of `residual` (M, N).

    :raises DataError: if there are too few samples.
    """
    m = samples.n_samples
    if m < 4 * _MIN_BLOCKS:
        raise DataError(f'{m} samples are too few to evaluate effects; record at least a minute')
    step = max(1, m // 4000)
    times = [correlation_time(column[::step], samples.runs[::step]) for column in residual.T]
    length = _CORRELATION_TIMES * step * float(np.median(times))
    length = float(np.clip(length, m / _MAX_BLOCKS, m / _MIN_BLOCKS))
    starts: list[int] = []
    for run in np.unique(samples.runs):
        rows = np.flatnonzero(samples.runs == run)
        parts = max(1, round(len(rows) / length))
        starts += [int(part[0]) for part in np.array_split(rows, parts)]
    first = np.array(starts, dtype=np.int64)
    run = samples.runs[first]
    return Blocks(np.append(first, m), run, _folds(run))


def _folds(run: IntArray) -> IntArray:
    """
    Return each block's fold (B,): a stretch of each run, a different one in the next run.

    A fold of whole runs may contain the only fast motion, or the only one with another payload.
    A fifth of a short run may contain the only samples of some poses, where gravity would
    extrapolate: with fewer than three runs each fold contains every fifth block.
    """
    fold = np.empty(len(run), dtype=np.int64)
    labels = np.unique(run)
    for number, label in enumerate(labels):
        blocks = np.flatnonzero(run == label)
        stretch = np.arange(len(blocks))
        if len(labels) >= _MIN_RUNS_FOR_STRETCHES and len(blocks) > N_FOLDS:
            stretch = stretch * N_FOLDS // len(blocks)
        fold[blocks] = (stretch + number) % N_FOLDS
    return np.unique(fold, return_inverse=True)[1].astype(np.int64)
