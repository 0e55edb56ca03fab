"""Rows of the regression: means over short times, with their blocks and folds."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.runs import run_time
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.regression.options import EngineOptions
import numpy as np

# Number of folds of a held-out error, and duration in s of a block that is held out in one piece.
N_FOLDS, _FOLD_SECONDS = 5, 10.0


@dataclass(frozen=True, eq=False)
class Rows:
    """
    Means over `row_seconds` of the used samples of a recording, R rows.

    `samples` (U,) are the numbers of the used samples, `first` (R,) where each row begins among
    them, `count` (R,) its number of samples; `run` (R,) and `t` (R,) its run and time. `block`
    (R,) numbers the blocks whose scores are independent, `fold` (R,) those held out together.
    """

    samples: IntArray
    first: IntArray
    count: IntArray
    run: IntArray
    t: FloatArray
    block: IntArray
    fold: IntArray

    @property
    def n_rows(self) -> int:
        return len(self.first)

    @property
    def weights(self) -> FloatArray:
        """Return the weight of each row (R,): its share of the usual number of samples."""
        return np.asarray(np.minimum(self.count / np.median(self.count), 1.0))

    def mean(self, values: FloatArray) -> FloatArray:
        """Return the means (R, ...) of values (M, ...) at all samples of the recording."""
        return mean_of(self.used(values), self.first, self.count)

    def used(self, values: FloatArray) -> FloatArray:
        """Return values (U, ...) at the used samples, of values (M, ...) at all."""
        return values if len(values) == len(self.samples) else values[self.samples]


def mean_of(values: FloatArray, first: IntArray, count: IntArray) -> FloatArray:
    """
    Return the means (G, ...) of consecutive groups of values (M, ...).

    In the memory they have the order (..., G): sums over rows are then fast.
    """
    columns = values.transpose(*range(1, values.ndim), 0)
    if len(first) == len(values):
        return np.ascontiguousarray(columns).transpose(-1, *range(values.ndim - 1))
    means = np.empty((*columns.shape[:-1], len(first)))
    for index in np.ndindex(columns.shape[:-1]):
        np.add.reduceat(columns[index], first, out=means[index])
    means /= count
    return means.transpose(-1, *range(values.ndim - 1))


def travel_of(q: FloatArray, first: IntArray) -> FloatArray:
    """Return the largest range (G,) in rad of a joint in consecutive groups of angles (U, N)."""
    return np.asarray((np.maximum.reduceat(q, first) - np.minimum.reduceat(q, first)).max(axis=1))


def begins_group(t: FloatArray, run: IntArray, q: FloatArray, width: float,
                 options: EngineOptions) -> BoolArray:
    """
    Return a mask (U,) of the samples that begin a group of one run and a duration.

    A pose that jumps begins one as well: nothing is known of the motion to it.

    :param t: of the run (U,) in s, `run` (U,), and angles q (U, N) in rad.
    :param width: longest duration of a group in s.
    """
    # A sample on the edge of a group is in the same group whatever the rounding.
    cell = np.floor(t / width + 1e-6).astype(np.int64)
    step = np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1)
    return np.asarray((np.diff(cell, prepend=-1) != 0) | (np.diff(run, prepend=-1) != 0)
                      | (step > options.jump_angle))


def rows_of(samples: JointSamples, options: EngineOptions,
            use: BoolArray | None = None) -> Rows:
    """
    Return the rows of a recording.

    :param use: mask (M,) of the samples to use; None for all.
    :raises FitError: if there are none.
    """
    used = np.arange(samples.n_samples) if use is None else np.flatnonzero(use)
    if not len(used):
        raise FitError('no samples to fit')
    run, t = samples.runs[used], run_time(samples)[used]
    width = _width(run, t, options)
    q = samples.q[used]
    first = _without_rests(np.flatnonzero(begins_group(t, run, q, width, options)), q, run, t,
                           options)
    count = np.diff(np.append(first, len(used)))
    time = np.add.reduceat(t, first) / count
    rows_run = run[first]
    return Rows(used, first, count, rows_run, time,
                _numbered(rows_run, time // options.block_seconds),
                _folds(rows_run, time))


def row_width(samples: JointSamples, use: BoolArray, options: EngineOptions) -> float:
    """Return the duration of a row in s, of samples of which a mask (M,) is fitted."""
    return _width(samples.runs[use], run_time(samples)[use], options)


def _width(run: IntArray, t: FloatArray, options: EngineOptions) -> float:
    duration = sum(float(np.ptp(t[run == k])) for k in np.unique(run))
    return max(options.row_seconds, duration / options.max_rows)


def _without_rests(first: IntArray, q: FloatArray, run: IntArray, t: FloatArray,
                   options: EngineOptions) -> IntArray:
    """
    Return the first samples of rows if an arm at rest has one row for `rest_seconds`.

    Static friction is unknown and constant at rest, so that more rows are no more information.

    :param first: (R,) where rows of equal duration begin, among q (U, N), run (U,), t (U,).
    """
    rests = travel_of(q, first) <= options.rest_angle
    kept = [0]
    for k in range(1, len(first)):
        start, here = first[kept[-1]], first[k]
        if not (rests[k] and rests[kept[-1]] and run[here] == run[start]
                and t[here] - t[start] < options.rest_seconds
                and np.abs(q[here] - q[start]).max() <= options.rest_angle):
            kept.append(k)
    return first[kept]


def _numbered(run: IntArray, cell: FloatArray) -> IntArray:
    """Return consecutive numbers of the pairs of run and cell."""
    pairs = run * (int(cell.max(initial=0)) + 1) + cell.astype(np.int64)
    return np.asarray(np.unique(pairs, return_inverse=True)[1], dtype=np.int64)


def _folds(run: IntArray, t: FloatArray) -> IntArray:
    """
    Return the fold of each row (R,): whole runs if there are enough, else blocks of ten seconds.

    Neighbouring rows are autocorrelated, so that rows drawn at random would not be held out.
    """
    runs = np.unique(run)
    if len(runs) >= N_FOLDS:
        return np.searchsorted(runs, run) % N_FOLDS
    duration = sum(float(np.ptp(t[run == k])) for k in runs)
    seconds = min(_FOLD_SECONDS, duration / N_FOLDS)
    return _numbered(run, t // max(seconds, 1e-9)) % N_FOLDS


@dataclass(frozen=True, eq=False)
class Condensed:
    """
    Means of groups of consecutive samples: `samples` (G), and `use` (G,) of those to fit.

    `group` (M,) is the number of the group of each measured sample.
    """

    samples: JointSamples
    use: BoolArray
    group: IntArray


def condensed(measured: JointSamples, use: BoolArray, options: EngineOptions) -> Condensed:
    """
    Return the means over groups of at most `row_samples` in a row, about `max_samples` in all.

    The columns of effects are computed at every sample, for every setting: more samples than
    resolve the motion within a row cost time and memory and change no mean. The torque of a row
    remains the mean of all its samples. Slow recordings are returned as they are.

    :param use: mask (M,) of the samples to fit; a group is fitted if most of its samples are.
    """
    t, width = run_time(measured), row_width(measured, use, options)
    rows = int(begins_group(t[use], measured.runs[use], measured.q[use], width, options).sum())
    per_row = min(options.row_samples, max(options.max_samples // max(rows, 1), 1))
    new = begins_group(t, measured.runs, measured.q, width / per_row, options)
    first = np.flatnonzero(new)
    if len(measured) < 2 * len(first):
        return Condensed(measured, use, np.arange(len(measured)))
    count = np.diff(np.append(first, len(measured)))

    def mean(values: FloatArray) -> FloatArray:
        return np.ascontiguousarray(mean_of(values, first, count))

    samples = JointSamples(
        measured.names, mean(measured.t), mean(measured.q), mean(measured.qd),
        mean(measured.tau), measured.runs[first], measured.run_labels, measured.starts,
        None if measured.qdd is None else mean(measured.qdd), measured.fingerprints)
    share = np.add.reduceat(use.astype(np.float64), first) / count
    return Condensed(samples, share > 0.5 if (share > 0.5).any() else share > 0.0,
                     np.cumsum(new) - 1)
