"""
Blocks of time that count as one observation each, and the folds that hold them out.

Residuals of neighbouring samples are alike: 10 000 of them at 100 Hz may be worth 130. A block
of ten correlation times is nearly independent of the next, so tests and intervals count blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.noise import correlation_time
import numpy as np

_CORRELATION_TIMES = 10.0
N_FOLDS = 5
_FEWEST = 15
# With so many runs a fold may hold out stretches: the poses of each are seen in another run.
_RUNS_OF_STRETCHES = 3
# Places of motion that an interval is drawn from.
_FEWEST_PLACES = 5
_MOST = 120


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
    def places(self) -> IntArray:
        """
        Return the run of each block (B,), or the stretch of it if runs are few, from 0.

        Another run is another motion: what a model lacks pulls a coefficient this way in one and
        that way in another, and may do so alike in all blocks of a run.
        """
        runs = np.unique(self.run, return_inverse=True)[1]
        n_runs = int(runs.max()) + 1
        parts = -(-_FEWEST_PLACES // n_runs)
        place = np.empty(self.count, dtype=np.int64)
        for run in range(n_runs):
            here = np.flatnonzero(runs == run)
            place[here] = run * parts + np.arange(len(here)) * parts // len(here)
        return np.unique(place, return_inverse=True)[1].astype(np.int64)

    @cached_property
    def by_fold(self) -> tuple[IntArray, tuple[slice, ...]]:
        """Return the samples (M,) in the order of their folds, and where each fold lies."""
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

    :raises DataError: if there are too few samples for the fewest blocks.
    """
    m = samples.n_samples
    if m < 4 * _FEWEST:
        raise DataError(f'{m} samples are too few to judge effects on; record at least a minute')
    step = max(1, m // 4000)
    times = [correlation_time(column[::step], samples.runs[::step]) for column in residual.T]
    length = _CORRELATION_TIMES * step * float(np.median(times))
    length = float(np.clip(length, m / _MOST, m / _FEWEST))
    starts: list[int] = []
    for run in np.unique(samples.runs):
        here = np.flatnonzero(samples.runs == run)
        parts = max(1, round(len(here) / length))
        starts += [int(part[0]) for part in np.array_split(here, parts)]
    first = np.array(starts, dtype=np.int64)
    run = samples.runs[first]
    return Blocks(np.append(first, m), run, _folds(run))


def _folds(run: IntArray) -> IntArray:
    """
    Return each block's fold (B,): a stretch of each run, another one in the next run.

    Whole runs would not do: what a fold holds out must be seen elsewhere, and the first run may
    be the only fast one, or the last the only one with another payload. A fifth of one short run
    may have poses that are seen nowhere else, so that the error there is that of gravity: of
    fewer than three runs each fold holds out every fifth block.
    """
    fold = np.empty(len(run), dtype=np.int64)
    labels = np.unique(run)
    for number, label in enumerate(labels):
        here = np.flatnonzero(run == label)
        stretch = np.arange(len(here))
        if len(labels) >= _RUNS_OF_STRETCHES and len(here) > N_FOLDS:
            stretch = stretch * N_FOLDS // len(here)
        fold[here] = (stretch + number) % N_FOLDS
    return np.unique(fold, return_inverse=True)[1].astype(np.int64)
