"""Bounded sample buffer that keeps diverse poses instead of the latest ones."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
import numpy as np

# Weight of velocity, in s, in the cell of a sample: samples of one pose with opposite directions
# of motion differ by friction.
VELOCITY_WEIGHT = 1.0

# Smallest edge of a cell, in rad: an arm at rest does not fill the buffer.
MIN_EDGE = 1e-3
# Number of the cell of 0. Its alternate bits place 0 a third of an edge from the border of its
# cell at every size, so that small values of both signs share a large cell.
_ORIGIN = 0x55555555
# Minimum share of the samples whose acceleration is known.
_MIN_KNOWN = 0.9


class SampleBuffer:
    """
    At most `capacity` samples of N joints, one for each cell of pose and velocity.

    A sample replaces that of its cell, but a held-out one replaces held-out ones alone. In a full
    buffer the edge of the cells doubles, and the newest sample of each stays: an arm at rest
    replaces its own samples, and those of earlier motion stay. An offer is O(N), and
    O(capacity · N) where the cells grow, which a motion requires once in capacity / 2 offers or
    less often.

    :param names: joint names.
    :param capacity: the number of samples to keep, at least 2.
    :param n_extra: the number of further figures that are kept with each sample.
    :raises OptionError: if the capacity is below 2.
    """

    def __init__(self, names: Sequence[str], capacity: int, n_extra: int = 0) -> None:
        if capacity < 2:
            raise OptionError(f'buffer: capacity is {capacity}; it must be at least 2')
        self._names = tuple(names)
        self._capacity = capacity
        self._run = 0
        self._last = -np.inf
        # The edge of a cell is `MIN_EDGE` times 2 to this power.
        self._doublings = 0
        # The row of each cell. A row has run, part, time, position, velocity, torque and
        # acceleration, and the further figures; there is one more than the capacity.
        self._row_of: dict[bytes, int] = {}
        self._free = list(range(capacity + 1))
        self._rows = np.zeros((capacity + 1, 3 + 4 * len(self._names) + n_extra))

    def __len__(self) -> int:
        return len(self._row_of)

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def offer(self, t: float, q: FloatArray, qd: FloatArray, tau: FloatArray,
              qdd: FloatArray | None = None, extra: Sequence[float] | FloatArray = (),
              is_held_out: bool = False) -> None:
        """
        Add a sample in place of the one in its cell.

        A time that does not increase starts a new run.

        :param t: time in s.
        :param q: positions (N,) in rad.
        :param qd: velocities (N,) in rad/s.
        :param tau: torques (N,) in N·m.
        :param qdd: accelerations (N,) in rad/s^2, None if they are unknown.
        :param extra: the further figures (K,) of the sample.
        :param is_held_out: a held-out sample replaces none that is not, and is replaced by none.
        :raises DataError: if a value is not finite.
        """
        measured = np.concatenate(([t], q, qd, tau))
        if not np.isfinite(measured).all():
            raise DataError('buffer: a sample is not finite')
        if t <= self._last:
            self._run += 1
        self._last = t
        unknown = np.full(len(self._names), np.nan)
        row = np.concatenate(([self._run, is_held_out], measured,
                              unknown if qdd is None else qdd, extra))
        key = _keys(self._cells(row[None]))[0]
        if key not in self._row_of:
            self._row_of[key] = self._free.pop()
        self._rows[self._row_of[key]] = row
        if len(self) > self._capacity:
            self._grow()

    def samples(self) -> JointSamples:
        """
        Return the samples in order of time, with runs numbered from 0.

        They have accelerations if most are known; unknown ones are then 0, as at isolated samples.
        """
        rows = self._rows[self._by_time()]
        runs, numbers = np.unique(rows[:, 0].astype(np.int64), return_inverse=True)
        q, qd, tau, qdd = np.split(rows[:, 3:3 + 4 * len(self._names)], 4, axis=1)
        labels = tuple(f'live {run}' for run in runs) or ('live 0',)
        known = np.asarray(np.isfinite(qdd).all(axis=1))
        is_known = bool(len(rows)) and known.mean() >= _MIN_KNOWN
        return JointSamples(self._names, rows[:, 2], q, qd, tau, numbers.reshape(-1), labels,
                            (0.0,) * len(labels),
                            np.where(known[:, None], qdd, 0.0) if is_known else None)

    def held_out(self) -> BoolArray:
        """Return a mask (M,) of the held-out samples, in the order of `samples`."""
        return np.asarray(self._rows[self._by_time(), 1] > 0.0)

    def extra(self) -> FloatArray:
        """Return the further figures (M, K) of the samples, in the order of `samples`."""
        return self._rows[self._by_time(), 3 + 4 * len(self._names):]

    def span(self) -> FloatArray:
        """Return the range of every joint over the samples, (N,) in rad; 0 without samples."""
        n = len(self._names)
        return np.ptp(self._rows[self._by_time(), 3:3 + n], axis=0) if len(self) else np.zeros(n)

    def snapshot(self) -> SampleBuffer:
        """Return a copy that later samples do not change."""
        result = copy(self)
        result._rows, result._row_of = self._rows.copy(), self._row_of.copy()
        result._free = self._free.copy()
        return result

    def _by_time(self) -> IntArray:
        """Return the rows of the samples in order of time."""
        used = np.fromiter(self._row_of.values(), dtype=np.int64, count=len(self))
        return np.asarray(used[np.lexsort((self._rows[used, 2], self._rows[used, 0]))])

    def _cells(self, rows: FloatArray) -> IntArray:
        """Return part and cell (M, 1 + 2N) of rows."""
        n = len(self._names)
        cells = np.empty((len(rows), 1 + 2 * n), dtype=np.int64)
        cells[:, 0] = rows[:, 1]
        cells[:, 1:1 + n] = np.floor(rows[:, 3:3 + n] / MIN_EDGE)
        cells[:, 1 + n:] = np.floor(rows[:, 3 + n:3 + 2 * n] * (VELOCITY_WEIGHT / MIN_EDGE))
        cells[:, 1:] = cells[:, 1:] + _ORIGIN >> self._doublings
        return cells

    def _grow(self) -> None:
        """Double the edge of the cells until the samples fit; the newest of each cell stays."""
        order = self._by_time()
        cells, rows = self._cells(self._rows)[order], order.tolist()
        while len(self) > self._capacity:
            self._doublings += 1
            cells[:, 1:] >>= 1
            self._row_of = dict(zip(_keys(cells), rows))
        self._free = list({*rows} - {*self._row_of.values()})


def _keys(cells: IntArray) -> list[bytes]:
    """Return one key for each row of integers (M, K)."""
    whole = np.dtype((np.void, cells.itemsize * cells.shape[1]))
    return [bytes(key) for key in cells.view(whole).ravel().tolist()]
