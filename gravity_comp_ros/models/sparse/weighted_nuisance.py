"""
Nuisance columns in units of the noise, separated by joint where possible.

Friction and offset of a joint do not affect other joints, so their basis and their least squares
separate into N small problems. With a column that acts on several joints, as effects of the whole
arm have, all joints form one problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.sparse.projected import (
    nuisance_coefficients, NuisanceBasis, scaled_spread)
import numpy as np


@dataclass(frozen=True, eq=False)
class _Part:
    """Columns of some joints: their indices, `rows` (R, K) of those joints, `spread` (K,)."""

    columns: IntArray
    joints: slice
    rows: FloatArray
    spread: FloatArray | None

    @cached_property
    def inside(self) -> FloatArray:
        return NuisanceBasis.of(self.rows, self.spread).inside


class WeightedNuisance:
    """
    K nuisance columns, with rows in units of the noise.

    :param columns: (K, N, M) torque per unit of coefficient; None for none.
    :param weights: (N, M) 1 / sigma.
    :param spread: (K,) prior standard deviations of the coefficients, per N·m of noise; None
        where all are free.
    """

    def __init__(self, columns: FloatArray | None, weights: FloatArray,
                 spread: FloatArray | None = None) -> None:
        self.count = 0 if columns is None else len(columns)
        self._parts: list[_Part] = []
        if columns is None or not self.count:
            return
        acts = np.asarray(columns.any(axis=2))
        n = len(weights)
        groups = [slice(n)] if (acts.sum(axis=1) > 1).any() else [
            slice(k, k + 1) for k in range(n)]
        for joints in groups:
            own = np.flatnonzero(acts[:, joints].any(axis=1))
            if not own.size:
                continue
            plain = columns[own, joints]
            rows = (plain * weights[joints]).reshape(len(own), -1).T
            self._parts.append(_Part(own, joints, rows, None if spread is None else scaled_spread(
                spread[own], plain.reshape(len(own), -1).T, rows)))

    def inside(self, rows: FloatArray) -> FloatArray:
        """Return rows (L, N, M) times B (`NuisanceBasis.inside`), shape (L, K')."""
        count = len(rows)
        return np.concatenate([np.zeros((count, 0)), *(
            rows[:, part.joints].reshape(count, len(part.rows)) @ part.inside
            for part in self._parts)], axis=1)

    def whitened(self, row: FloatArray) -> FloatArray:
        """Return P P r of a row r (N, M), whose product with r is the squared whitened row."""
        result = row.copy()
        for part in self._parts:
            own = result[part.joints].ravel()
            own -= part.inside @ (own @ part.inside)
            result[part.joints] = own.reshape(-1, row.shape[1])
        return result

    def coefficients(self, target: FloatArray) -> FloatArray:
        """Return the most probable coefficients (K,) for a target (N, M) in units of noise."""
        coefficients = np.zeros(self.count)
        for part in self._parts:
            coefficients[part.columns] = nuisance_coefficients(
                part.rows, target[part.joints].ravel(), part.spread)
        return coefficients

    def precision(self) -> FloatArray:
        """Return the diagonal (K,) of the prior precision of the coefficients."""
        precision = np.zeros(self.count)
        for part in self._parts:
            if part.spread is not None:
                precision[part.columns] = part.spread ** -2
        return precision
