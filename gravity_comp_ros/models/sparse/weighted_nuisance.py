"""
Nuisance columns in units of the noise, joint by joint where they can be.

Friction and offset of a joint have no part in the torque of another, so that their basis and
their least squares fall apart into N small ones. A column that acts on several joints, as effects
of the whole arm have them, leaves one part of all joints.
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
    """Columns of some joints: their numbers, `rows` (R, K) of those joints, `spread` (K,)."""

    columns: IntArray
    joints: slice
    rows: FloatArray
    spread: FloatArray | None

    @cached_property
    def inside(self) -> FloatArray:
        return NuisanceBasis.of(self.rows, self.spread).inside


class WeightedNuisance:
    """
    K columns of torque beside gravity, their rows in units of the noise.

    :param columns: (K, N, M) torque per unit of coefficient; None for none.
    :param weights: (N, M) 1 / sigma.
    :param spread: (K,) standard deviations of the coefficients before any data, per N·m of
        noise; None where all are free.
    """

    def __init__(self, columns: FloatArray | None, weights: FloatArray,
                 spread: FloatArray | None = None) -> None:
        self.count = 0 if columns is None else len(columns)
        self._parts: list[_Part] = []
        if columns is None or not self.count:
            return
        acts = np.asarray(columns.any(axis=2))
        n = len(weights)
        places = [slice(n)] if (acts.sum(axis=1) > 1).any() else [
            slice(k, k + 1) for k in range(n)]
        for joints in places:
            here = np.flatnonzero(acts[:, joints].any(axis=1))
            if not here.size:
                continue
            plain = columns[here, joints]
            rows = (plain * weights[joints]).reshape(len(here), -1).T
            own = None if spread is None else scaled_spread(
                spread[here], plain.reshape(len(here), -1).T, rows)
            self._parts.append(_Part(here, joints, rows, own))

    def inside(self, rows: FloatArray) -> FloatArray:
        """Return rows (L, N, M) times B (`NuisanceBasis.inside`), shape (L, K')."""
        count = len(rows)
        return np.concatenate([np.zeros((count, 0)), *(
            rows[:, part.joints].reshape(count, len(part.rows)) @ part.inside
            for part in self._parts)], axis=1)

    def whitened(self, row: FloatArray) -> FloatArray:
        """Return P P r of a row r (N, M): its products with r are squares of the whitened row."""
        found = row.copy()
        for part in self._parts:
            left = found[part.joints].ravel()
            left -= part.inside @ (left @ part.inside)
            found[part.joints] = left.reshape(-1, row.shape[1])
        return found

    def coefficients(self, target: FloatArray) -> FloatArray:
        """Return the likeliest coefficients (K,) for a target (N, M) in units of the noise."""
        found = np.zeros(self.count)
        for part in self._parts:
            found[part.columns] = nuisance_coefficients(
                part.rows, target[part.joints].ravel(), part.spread)
        return found

    def precision(self) -> FloatArray:
        """Return what is known of the coefficients before any data, the diagonal (K,)."""
        known = np.zeros(self.count)
        for part in self._parts:
            if part.spread is not None:
                known[part.columns] = part.spread ** -2
        return known
