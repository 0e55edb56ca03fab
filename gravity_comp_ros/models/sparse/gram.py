"""
Products of the unit-length columns of a support with all others.

Up to nine joints the products of one column with all 3^N columns are a single pass over the halves
(`Design.correlate`). This is cheaper than building the hundred candidate columns of a search, and
the products are reused in every later step. With more joints only the required columns are built.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.sparse.regressor import Design
import numpy as np

# Maximum number of columns for which all products are stored: nine joints.
_MAX_COLUMNS = 3 ** 9


class Gram:
    """
    Cache of the columns of all supports so far, and of their products.

    :param per_length: one over the length of every column of the design, 0 for unusable ones.
    """

    def __init__(self, design: Design, per_length: FloatArray) -> None:
        self.design, self.per_length = design, per_length
        self.is_large = design.n_columns > _MAX_COLUMNS
        self._place: dict[int, int] = {}
        self._row: dict[int, int] = {}
        self._columns = np.zeros((0, design.n_rows))
        self._within = np.zeros((0, 0))
        self._with_all = np.zeros((0, 0 if self.is_large else design.n_columns))

    def columns(self, support: IntArray) -> FloatArray:
        """Return the columns of a support, transposed, shape (K, R)."""
        places = self._places(support)
        return self._columns[places]

    def within(self, support: IntArray) -> FloatArray:
        """Return the products of the columns of a support with each other, shape (K, K)."""
        places = self._places(support)
        return self._within[places[:, None], places]

    def between(self, support: IntArray, others: IntArray) -> FloatArray:
        """Return the products of the columns of a support with others, shape (K, K')."""
        places = self._places(support)
        if self.is_large:
            return self._columns[places] @ self.built(others).T
        rows = self._rows(places)
        return self._with_all[rows[:, None], others]

    def explained(self, support: IntArray, x: FloatArray) -> FloatArray:
        """Return the products (3^N,) of all columns with a support's prediction for x (K,)."""
        places = self._places(support)
        if self.is_large:
            return self.design.correlate(x @ self._columns[places]) * self.per_length
        rows = self._rows(places)
        return x @ self._with_all[rows]

    def with_target(self, b: FloatArray) -> FloatArray:
        """Return the products of all columns with b (R,): (3^N,)."""
        return self.design.correlate(b) * self.per_length

    def _rows(self, places: IntArray) -> IntArray:
        """Return the rows of the stored products with all columns, for columns at `places`."""
        new = [place for place in places.tolist() if place not in self._row]
        if new:
            products = self.design.correlate_many(self._columns[new].T) * self.per_length
            self._row.update(zip(new, range(len(self._row), len(self._row) + len(new))))
            self._with_all = np.concatenate([self._with_all, products])
        return np.array([self._row[place] for place in places.tolist()], dtype=np.int64)

    def _places(self, support: IntArray) -> IntArray:
        """Return the places of a support's columns in the cache; missing ones are built."""
        new = [k for k in support.tolist() if k not in self._place]
        if new:
            added = self.built(np.array(new))
            cross = self._columns @ added.T
            self._within = np.block([[self._within, cross], [cross.T, added @ added.T]])
            self._columns = np.concatenate([self._columns, added])
            self._place.update(zip(new, range(len(self._place), len(self._columns))))
        return np.array([self._place[k] for k in support.tolist()], dtype=np.int64)

    def built(self, indices: IntArray) -> FloatArray:
        """Return columns of unit length, transposed, shape (K, R)."""
        return (self.design.columns(indices) * self.per_length[indices]).T
