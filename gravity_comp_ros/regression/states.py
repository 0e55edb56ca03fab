"""
States at which shared columns are computed: means over parts of rows in which no joint moves far.

Gravity and dynamics are smooth, so that their mean over a row is that at few states: within
`EngineOptions.cell_angle` the curvature of sin q changes the mean by angle^2 / 24. Cost and memory
do not grow with the rate of a recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.regression.rows import mean_of, Rows, travel_of
from gravity_comp_ros.regression.shared import State
import numpy as np

# Number of states of a batch of columns, which fit into the processor's cache.
_BATCH = 512


@dataclass(frozen=True, eq=False)
class States:
    """C states of R rows: their `count` (C,) of samples, and the `first` (R,) of each row."""

    state: State
    count: IntArray
    first: IntArray
    row_count: IntArray

    def mean(self, columns: Callable[[State], FloatArray]) -> FloatArray:
        """
        Return the means (R, ...) over rows of columns (B, ...) at states.

        In the memory they have the order (..., R).
        """
        edges, start = np.append(self.first, len(self.count)), 0
        result: FloatArray | None = None
        while start < len(self.first):
            end = int(np.searchsorted(edges, edges[start] + _BATCH, side='right')) - 1
            end = min(max(end, start + 1), len(self.first))
            here = slice(int(edges[start]), int(edges[end]))
            values = self._mean(np.moveaxis(columns(self.state.select(here)), 0, -1),
                                start, end, here)
            if result is None:
                result = np.empty((*values.shape[:-1], len(self.first)))
            result[..., start:end] = values
            start = end
        assert result is not None
        return np.moveaxis(result, -1, 0)

    def _mean(self, values: FloatArray, start: int, end: int, here: slice) -> FloatArray:
        if values.shape[-1] == end - start:
            return values
        total = np.add.reduceat(values * self.count[here], self.first[start:end] - here.start,
                                axis=-1)
        return np.asarray(total / self.row_count[start:end])


def states_of(rows: Rows, q: FloatArray, qd: FloatArray, qdd: FloatArray,
              angle: float) -> States:
    """
    Return the states of rows.

    :param q: angles (M, N) of all samples, with their speeds `qd` and accelerations `qdd`.
    :param angle: largest range in rad of a joint in one state.
    """
    travel = travel_of(q[rows.samples], rows.first)
    parts = np.clip(np.ceil(travel / angle), 1, rows.count).astype(np.int64)
    row = np.repeat(np.arange(rows.n_rows), parts)
    number = np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)
    first = rows.first[row] + number * rows.count[row] // parts[row]
    count = np.diff(np.append(first, len(rows.samples)))
    state = State(*(mean_of(x[rows.samples], first, count) for x in (q, qd, qdd)))
    return States(state, count, np.cumsum(parts) - parts, rows.count)
