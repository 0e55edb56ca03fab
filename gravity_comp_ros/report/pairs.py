"""Error and number of samples over pairs of joints, and what was never visited."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
import numpy as np

# No narrower than this, so that a joint that stands still has a cell.
_LEAST_RANGE = 1e-3


@dataclass(frozen=True)
class PairGrid:
    """
    All pairs i <= j of N joints, each cut into `cells` by `cells` places.

    `edges` (N, cells + 1) in rad cut each joint's range. `first`, `second`, `column`, `row`
    (K,) tell the pair and place of each visited cell: column counts along the first joint.
    `count` (K,) is its number of samples, `rms` (K, N) each joint's residual there in N·m.
    `visited` (N, N) is the share of each pair's cells that have samples.
    """

    cells: int
    edges: FloatArray
    first: IntArray
    second: IntArray
    column: IntArray
    row: IntArray
    count: IntArray
    rms: FloatArray
    visited: FloatArray


def places(q: FloatArray, edges: FloatArray) -> IntArray:
    """Return the place (M, N) of each pose (M, N) along each joint."""
    cells = edges.shape[1] - 1
    found = [np.searchsorted(edges[n], q[:, n], side='right') - 1 for n in range(q.shape[1])]
    return np.clip(np.column_stack(found), 0, cells - 1).astype(np.int64)


def pair_grid(q: FloatArray, residual: FloatArray, cells: int = 12) -> PairGrid:
    """
    Return the error over pairs of joints.

    :param q: poses (M, N) in rad.
    :param residual: (M, N) in N·m.
    """
    n = q.shape[1]
    low, high = q.min(axis=0), q.max(axis=0)
    wide = np.maximum(high - low, _LEAST_RANGE)
    middle = 0.5 * (low + high)
    edges = np.linspace(middle - 0.5 * wide, middle + 0.5 * wide, cells + 1).T
    place, squares = places(q, edges), residual ** 2
    parts: list[tuple[IntArray, ...]] = []
    rms, visited = [], np.zeros((n, n))
    for i in range(n):
        for j in range(i, n):
            cell = place[:, i] * cells + place[:, j]
            count = np.bincount(cell, minlength=cells * cells)
            there = np.flatnonzero(count)
            sums = np.column_stack([np.bincount(cell, squares[:, k], cells * cells)[there]
                                    for k in range(residual.shape[1])])
            rms.append(np.sqrt(sums / count[there, None]))
            whole = cells if i == j else cells * cells
            visited[i, j] = visited[j, i] = len(there) / whole
            parts.append((np.full(len(there), i), np.full(len(there), j), there // cells,
                          there % cells, count[there]))
    first, second, column, row, count = (np.concatenate(x).astype(np.int64)
                                         for x in zip(*parts))
    return PairGrid(cells, edges, first, second, column, row, count, np.vstack(rms), visited)
