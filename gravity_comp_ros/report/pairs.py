"""Residual, sample count and coverage over pairs of joints."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
import numpy as np

# Minimum range of a joint, in rad, so that a joint at rest has a cell.
_MIN_RANGE = 1e-3


@dataclass(frozen=True)
class PairGrid:
    """
    Grid of `cells` by `cells` over the ranges of each pair i <= j of N joints.

    `edges` (N, cells + 1) in rad divide each joint's range. `first` and `second` (K,) are the
    joints of each of K visited cells, `column` and `row` (K,) its indices along them. `count`
    (K,) is its number of samples, `rms` (K, N) the RMS residual of each joint in N·m. `visited`
    (N, N) is the share of cells with samples of each pair.
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
    """Return the cell index (M, N) of each pose (M, N) along each joint."""
    cells = edges.shape[1] - 1
    indices = [np.searchsorted(edges[n], q[:, n], side='right') - 1 for n in range(q.shape[1])]
    return np.clip(np.column_stack(indices), 0, cells - 1).astype(np.int64)


def pair_grid(q: FloatArray, residual: FloatArray, cells: int = 12) -> PairGrid:
    """
    Return the grid over pairs of joints.

    :param q: poses (M, N) in rad.
    :param residual: (M, N) in N·m.
    """
    n = q.shape[1]
    low, high = q.min(axis=0), q.max(axis=0)
    width = np.maximum(high - low, _MIN_RANGE)
    middle = 0.5 * (low + high)
    edges = np.linspace(middle - 0.5 * width, middle + 0.5 * width, cells + 1).T
    cells_of, squares = places(q, edges), residual ** 2
    parts: list[tuple[IntArray, ...]] = []
    rms, visited = [], np.zeros((n, n))
    for i in range(n):
        for j in range(i, n):
            cell = cells_of[:, i] * cells + cells_of[:, j]
            count = np.bincount(cell, minlength=cells * cells)
            filled = np.flatnonzero(count)
            sums = np.column_stack([np.bincount(cell, squares[:, k], cells * cells)[filled]
                                    for k in range(residual.shape[1])])
            rms.append(np.sqrt(sums / count[filled, None]))
            whole = cells if i == j else cells * cells
            visited[i, j] = visited[j, i] = len(filled) / whole
            parts.append((np.full(len(filled), i), np.full(len(filled), j), filled // cells,
                          filled % cells, count[filled]))
    first, second, column, row, count = (np.concatenate(x).astype(np.int64)
                                         for x in zip(*parts))
    return PairGrid(cells, edges, first, second, column, row, count, np.vstack(rms), visited)
