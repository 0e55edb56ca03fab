"""Bounded sample buffer that keeps diverse poses instead of the latest ones."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
import numpy as np

# Weight of velocity, in s, in the distance of two samples: samples of one pose with opposite
# directions of motion differ by friction.
VELOCITY_WEIGHT = 1.0

# Minimum distance, in rad, of a new sample that is added; a closer one replaces the kept one, so
# that an arm at rest does not fill the buffer.
MIN_DISTANCE = 1e-3
# Minimum share of the samples whose acceleration is known.
_MIN_KNOWN = 0.9


class SampleRing:
    """
    At most `capacity` samples of N joints.

    The distance of two samples is that of their poses and velocities. A sample closer than
    `MIN_DISTANCE` to a kept one replaces it. In a full buffer every other new sample is added and
    the older one of the closest pair is removed: an arm at rest replaces its own samples, and
    those of earlier motion stay. Memory is O(capacity); an offer costs O(capacity · N), and as
    much again for every sample whose nearest neighbour is removed.

    :param names: joint names.
    :param capacity: the number of samples to keep, at least 2.
    :param n_extra: the number of further figures that are kept with each sample.
    :raises OptionError: if the capacity is below 2.
    """

    def __init__(self, names: Sequence[str], capacity: int, n_extra: int = 0) -> None:
        if capacity < 2:
            raise OptionError(f'buffer: capacity is {capacity}; it must be at least 2')
        self._names = tuple(names)
        n = len(self._names)
        # One row more than the capacity, for the new sample before one is removed.
        rows = capacity + 1
        self._capacity = capacity
        self._count = 0
        self._offered = 0
        self._run = 0
        self._last = -np.inf
        self._t = np.zeros(rows)
        self._values = np.zeros((rows, 4, n))
        self._extra = np.zeros((rows, n_extra))
        self._features = np.zeros((rows, 2 * n))
        self._runs = np.zeros(rows, dtype=np.int64)
        self._order = np.zeros(rows, dtype=np.int64)
        self._near = np.full(rows, np.inf)
        self._nearest = np.full(rows, -1, dtype=np.int64)

    def __len__(self) -> int:
        return self._count

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def offer(self, t: float, q: FloatArray, qd: FloatArray, tau: FloatArray,
              qdd: FloatArray | None = None, extra: FloatArray | None = None) -> None:
        """
        Add a sample; from a full buffer one is removed.

        A time that does not increase starts a new run.

        :param t: time in s.
        :param q: positions (N,) in rad.
        :param qd: velocities (N,) in rad/s.
        :param tau: torques (N,) in N·m.
        :param qdd: accelerations (N,) in rad/s^2, None if they are unknown.
        :param extra: further figures (K,) of the sample; None for zeros.
        :raises DataError: if a value is not finite.
        """
        unknown = np.full(len(self._names), np.nan)
        sample = np.array((q, qd, tau, unknown if qdd is None else qdd), dtype=np.float64)
        if not (np.isfinite(sample[:3]).all() and np.isfinite(t)):
            raise DataError('buffer: a sample is not finite')
        if t <= self._last:
            self._run += 1
        self._last = t
        feature = np.concatenate((sample[0], sample[1] * VELOCITY_WEIGHT))
        distances = self._distances(feature)
        nearest = int(np.argmin(distances)) if self._count else -1
        if nearest >= 0 and distances[nearest] < MIN_DISTANCE ** 2:
            # The feature is not replaced: otherwise a slow creep would move a single sample.
            self._put(nearest, t, sample, extra)
            return
        row = self._count
        self._count += 1
        self._features[row] = feature
        self._put(row, t, sample, extra)
        self._link(row, distances)
        if self._count > self._capacity:
            first = int(np.argmin(self._near[:self._count]))
            second = int(self._nearest[first])
            self._remove(first if self._order[first] < self._order[second] else second)

    def samples(self) -> JointSamples:
        """
        Return the samples in order of time, with runs numbered from 0.

        They have accelerations if most are known; unknown ones are then 0, as at isolated samples.
        """
        n, order = self._count, self._by_time()
        runs, numbers = np.unique(self._runs[:n][order], return_inverse=True)
        values = self._values[:n][order]
        labels = tuple(f'live {run}' for run in runs) or ('live 0',)
        known = np.asarray(np.isfinite(values[:, 3]).all(axis=1))
        qdd = np.where(known[:, None], values[:, 3], 0.0) if (
            n and known.mean() >= _MIN_KNOWN) else None
        return JointSamples(self._names, self._t[:n][order], values[:, 0], values[:, 1],
                            values[:, 2], numbers.reshape(-1), labels, (0.0,) * len(labels), qdd)

    def extra(self) -> FloatArray:
        """Return the further figures (M, K) of the samples, in the order of `samples`."""
        return self._extra[:self._count][self._by_time()]

    def _by_time(self) -> IntArray:
        return np.lexsort((self._t[:self._count], self._runs[:self._count]))

    def span(self) -> FloatArray:
        """Return the range of every joint over the samples, (N,) in rad; 0 without samples."""
        q = self._values[:self._count, 0]
        return np.ptp(q, axis=0) if self._count else np.zeros(len(self._names))

    def _put(self, row: int, t: float, sample: FloatArray, extra: FloatArray | None) -> None:
        self._t[row] = t
        self._values[row] = sample
        self._extra[row] = 0.0 if extra is None else extra
        self._runs[row] = self._run
        self._order[row] = self._offered
        self._offered += 1

    def _distances(self, feature: FloatArray) -> FloatArray:
        difference = self._features[:self._count] - feature
        return np.einsum('ij,ij->i', difference, difference)

    def _link(self, row: int, distances: FloatArray) -> None:
        """Update nearest neighbours for the newest row with `distances` to the rows before it."""
        self._near[row], self._nearest[row] = np.inf, -1
        if row == 0:
            return
        closer = np.flatnonzero(distances < self._near[:row])
        self._near[closer] = distances[closer]
        self._nearest[closer] = row
        self._nearest[row] = np.argmin(distances)
        self._near[row] = distances[self._nearest[row]]

    def _remove(self, row: int) -> None:
        last = self._count - 1
        orphans = np.flatnonzero(self._nearest[:self._count] == row)
        for array in (self._t, self._values, self._extra, self._features, self._runs, self._order,
                      self._near, self._nearest):
            array[row] = array[last]
        self._count = last
        nearest = self._nearest[:last]
        nearest[nearest == last] = row
        for orphan in orphans:
            moved = row if orphan == last else int(orphan)
            distances = self._distances(self._features[moved])
            distances[moved] = np.inf
            nearest[moved] = np.argmin(distances)
            self._near[moved] = distances[nearest[moved]]
