"""Bounded buffer that keeps samples of diverse poses instead of the latest ones."""

from __future__ import annotations

from typing import Generic, TypeVar

from gravity_comp_ros.data.samples import FloatArray, IntArray
import numpy as np

# Weight of velocity, in s, in the cell of a sample: samples of one pose with opposite directions
# of motion differ by friction.
VELOCITY_WEIGHT = 1.0
# Smallest edge of a cell, in rad: an arm at rest does not fill the buffer.
MIN_EDGE = 1e-3
# Number of the cell of 0. Its alternate bits place 0 a third of an edge from the border of its
# cell at every size, so that small values of both signs share a large cell.
_ORIGIN = 0x55555555

T = TypeVar('T')


class SampleBuffer(Generic[T]):
    """
    At most `capacity` samples of any kind, one for each cell of pose and velocity.

    A sample replaces that of its cell, but a held-out one replaces held-out ones alone. In a full
    buffer the edge of the cells doubles, and the newest sample of each stays: an arm at rest
    replaces its own samples, and those of earlier motion stay. An offer is O(N), and
    O(capacity · N) where the cells grow, which a motion requires once in capacity / 2 offers or
    less often.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        # The edge of a cell is `MIN_EDGE` times 2 to this power.
        self._doublings = 0
        self._cells: dict[bytes, tuple[IntArray, T]] = {}

    def __len__(self) -> int:
        return len(self._cells)

    def samples(self) -> list[T]:
        """Return the samples in the order in which they were offered."""
        return [sample for _, sample in self._cells.values()]

    def offer(self, q: FloatArray, qd: FloatArray, sample: T, is_held_out: bool = False) -> None:
        """
        Add a sample in place of the one in its cell.

        :param q: positions (N,) in rad. :param qd: velocities (N,) in rad/s.
        :param is_held_out: a held-out sample replaces none that is not, and is replaced by none.
        """
        place = np.concatenate((q, VELOCITY_WEIGHT * qd)) / MIN_EDGE
        cell = np.concatenate(([is_held_out], np.floor(place))).astype(np.int64)
        cell[1:] = cell[1:] + _ORIGIN >> self._doublings
        self._cells.pop(key := cell.tobytes(), None)
        self._cells[key] = cell, sample
        if len(self) > self._capacity:
            self._grow()

    def _grow(self) -> None:
        """Double the edge of the cells until the samples fit; the newest of each cell stays."""
        kept = list(self._cells.values())
        cells, newest = np.array([cell for cell, _ in kept]), dict[bytes, int]()
        while not newest or len(newest) > self._capacity:
            self._doublings += 1
            cells[:, 1:] >>= 1
            newest = {cell.tobytes(): k for k, cell in enumerate(cells)}
        self._cells = {cells[k].tobytes(): (cells[k], kept[k][1]) for k in sorted(newest.values())}
