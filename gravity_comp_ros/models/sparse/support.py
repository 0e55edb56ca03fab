"""
Selection of the support by description length, starting from the features proposed by L1.

Over a small motion many features are nearly collinear, and the L1 norm selects any of them. A
prior distinguishes them outside that motion: the feature with fewer factors is more probable. The
score is a description length, twice the negative log posterior of the support,

    score(S) = chi^2(S) + sum_{k in S} cost(k),    cost(k) = ln R + 2 (-ln P(k)),

where chi^2 is the weighted sum of squares after an unpenalised fit, ln R the price of a
coefficient in BIC, and P(k) a prior over features in which each joint has the factor 1 with
probability 2/3, sin and cos with 1/6 each. It sums to one over all 3^N features, so it also
accounts for the number of features tried. Steps that lower the score are taken: drop a feature,
else add one, else swap one with a neighbour (one factor changed).
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.sparse.lasso import column_lengths, has_length
from gravity_comp_ros.models.sparse.regressor import Design
import numpy as np
from scipy import linalg

_P_ONE = 2.0 / 3.0
_P_SIN_OR_COS = 1.0 / 6.0
_MAX_STEPS = 400
# Minimum decrease of the score by a step, above rounding.
_MIN_DECREASE = 1e-6
# Number of candidates for an addition.
_CANDIDATES = 30
# Number of promising features tried first where products with all features are expensive.
_POOL = 300
# Supports whose score is within this of the best (a posterior ratio of 1 to 50) are equivalent.
_EQUIVALENT = 8.0
# A column is linearly dependent if less than this share of its squared length lies outside the
# span of the support.
_DEPENDENT = 1e-8
# Maximum number of columns for which all products are stored: nine joints.
_MAX_COLUMNS = 3 ** 9
# Number of successive downdates of the inverse before it is computed again.
_DOWNDATES = 20

# Change of the score by a step, and the resulting support.
Move = tuple[float, IntArray]


@dataclass(frozen=True, eq=False)
class Refit:
    """An unpenalised weighted fit on a support: coefficients and chi^2."""

    indices: IntArray
    x: FloatArray
    chi2: float

    @classmethod
    def empty(cls) -> Refit:
        """Return the fit on no features, before any data was seen."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros(0), np.inf)


def costs(n_joints: int, n_rows: int) -> FloatArray:
    """Return the price of every feature in chi^2, shape (3^N,)."""
    factor = -2.0 * np.log([_P_ONE, _P_SIN_OR_COS, _P_SIN_OR_COS])
    price = np.array([np.log(max(n_rows, 2))])
    for _ in range(n_joints):
        price = (price[:, None] + factor).ravel()
    return price


def refit(design: Design, b: FloatArray, indices: IntArray) -> Refit:
    """
    Fit b on selected columns without a penalty, which removes the shrinkage of L1.

    For linearly dependent columns it is the solution of minimum norm.
    """
    indices = np.sort(np.asarray(indices, dtype=np.int64))
    if not indices.size:
        return Refit(indices, np.zeros(0), float(b @ b))
    a = design.columns(indices)
    lengths = np.linalg.norm(a, axis=0)
    lengths[lengths == 0.0] = 1.0
    x = lstsq(a / lengths, b, rcond=1e-12) / lengths
    residual = b - a @ x
    return Refit(indices, x, float(residual @ residual))


def neighbours_of(indices: IntArray, n_joints: int) -> IntArray:
    """Return the features that differ from each of K features in one factor, (K, 2 N)."""
    powers = 3 ** np.arange(n_joints - 1, -1, -1, dtype=np.int64)
    factors = (indices[:, None] // powers) % 3
    other = np.stack([(factors + 1) % 3, (factors + 2) % 3], axis=-1)
    return (indices[:, None, None] + (other - factors[:, :, None]) * powers[:, None]).reshape(
        len(indices), 2 * n_joints)


def gram_of(design: Design, usable: BoolArray) -> Gram:
    """Return the products of columns shared by the searches of one design."""
    lengths = column_lengths(design)
    return Gram(design, 1.0 / np.where(usable & has_length(lengths), lengths, np.inf))


def select_support(design: Design, b: FloatArray, indices: IntArray, n_joints: int,
                   usable: BoolArray, gram: Gram | None = None) -> Refit:
    """
    Return the support of minimum description length reached by single steps from `indices`.

    :param usable: mask over all features; the others are not selected.
    :param gram: products from earlier searches of this design.
    """
    search = _Search(b, n_joints, gram or gram_of(design, usable),
                     np.asarray(indices, dtype=np.int64))
    for _ in range(_MAX_STEPS):
        if not search.step():
            break
    return refit(design, b, search.support)


def score(refit: Refit, n_joints: int, n_rows: int) -> float:
    """Return the description length of a refitted support (module docstring)."""
    return refit.chi2 + float(costs(n_joints, n_rows)[refit.indices].sum())


def equivalents(b: FloatArray, best: Refit, n_joints: int, gram: Gram) -> list[IntArray]:
    """
    Return the supports whose score is within `_EQUIVALENT` of the best: single swaps of features.

    If the data cannot distinguish two features, a mixture of both halves the error of the wrong
    one outside the trained range.

    :param gram: products of the columns of the usable features (`gram_of`).
    """
    swaps = _Search(b, n_joints, gram, best.indices).swaps()
    return [support for change, support in swaps if change < _EQUIVALENT]


class Gram:
    """
    Cache of the columns of all supports so far, of unit length, and of their products.

    Up to nine joints the products of one column with all 3^N columns are a single pass over the
    halves (`Design.correlate`). This is cheaper than building the hundred candidate columns of a
    search, and the products are reused in every later step. With more joints only the required
    columns are built.

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


class _Search:
    """A support, the inverse of its Gram matrix, its residual, and the steps from it."""

    def __init__(self, b: FloatArray, n_joints: int, gram: Gram, support: IntArray) -> None:
        self.b, self.n_joints, self.gram = b, n_joints, gram
        self.usable = gram.per_length > 0.0
        self.with_target = gram.with_target(b)
        self.costs = costs(n_joints, gram.design.n_rows)
        self.support = np.zeros(0, dtype=np.int64)
        self.inverse: FloatArray = np.zeros((0, 0))
        self._downdates = 0
        self._pool = np.zeros(0, dtype=np.int64)
        self.change_support(np.sort(support[self.usable[support]]))

    def change_support(self, support: IntArray) -> None:
        """Set the support, without linearly dependent features."""
        dropped = self._dropped(support)
        if dropped is None:
            support = self._independent(support)
            self.inverse = np.asarray(np.linalg.inv(self.gram.within(support)), np.float64)
            self._downdates = 0
        else:
            # A subset of independent columns is independent: downdate the inverse.
            kept, row = np.delete(np.arange(len(self.support)), dropped), self.inverse[dropped]
            downdate = np.outer(row[kept], row[kept] / row[dropped])
            self.inverse = np.asarray(self.inverse[kept[:, None], kept] - downdate)
            self._downdates += 1
        self.support = support
        columns = self.gram.columns(support)
        self.x = self.inverse @ (columns @ self.b)
        self.residual = self.b - self.x @ columns
        self.score = float(self.residual @ self.residual + self.costs[self.support].sum())
        self._correlation: FloatArray | None = None

    def _dropped(self, support: IntArray) -> int | None:
        """Return the place of the feature whose drop leads to `support`, else None."""
        if len(support) + 1 != len(self.support) or self._downdates == _DOWNDATES:
            return None
        kept = np.isin(self.support, support, assume_unique=True)
        return int(np.argmin(kept)) if kept.sum() == len(support) else None

    @property
    def correlation(self) -> FloatArray:
        """Return the products of all columns with the residual, 0 where unusable."""
        if self._correlation is None:
            self._correlation = self.with_target - self.gram.explained(self.support, self.x)
        return self._correlation

    def step(self) -> bool:
        """
        Take the best drop, else the best addition, else the best swap that lowers the score.

        The predicted change is computed from the Gram matrix, whose rounding errors can exceed the
        noise for nearly collinear columns, so a move that does not lower the score is undone.
        """
        before, previous = self.score, self.support
        for moves in (self.drops, self.additions, self.swaps):
            change, support = min(moves(), key=lambda move: move[0], default=(0.0, None))
            if support is None or change >= -_MIN_DECREASE:
                continue
            self.change_support(np.sort(support))
            if self.score < before:
                return True
            self.change_support(previous)
        return False

    def drops(self) -> list[Move]:
        """Return the best feature to drop: chi^2 rises by x_k^2 / (G^-1)_kk."""
        if not self.support.size:
            return []
        change = self._losses() - self.costs[self.support]
        best = int(np.argmin(change))
        return [(float(change[best]), np.delete(self.support, best))]

    def additions(self) -> list[Move]:
        """Return the best addition among the most promising features."""
        moves = self._best_of(self._pool, self.gram.built(self._pool) @ self.residual)
        if moves and moves[0][0] < -_MIN_DECREASE:
            return moves
        bound = np.where(self.usable, self.correlation ** 2 - self.costs, -np.inf)
        if self.gram.is_large:
            self._pool = _largest(bound, _POOL)
        bound[self.support] = -np.inf
        candidates = _largest(bound, _CANDIDATES)
        return self._best_of(candidates, self.correlation[candidates])

    def _best_of(self, features: IntArray, correlation: FloatArray) -> list[Move]:
        """Return the best addition among features, given their products with the residual."""
        free = np.flatnonzero(~np.isin(features, self.support))
        bound = correlation[free] ** 2 - self.costs[features[free]]
        free = free[_largest(bound, _CANDIDATES)]
        if not free.size:
            return []
        candidates, correlation = features[free], correlation[free]
        cross = self.gram.between(self.support, candidates)
        outside = 1.0 - np.einsum('ij,ij->j', cross, self.inverse @ cross)
        change = self.costs[candidates] - _gains(correlation, outside)
        best = int(np.argmin(change))
        return [(float(change[best]), np.append(self.support, candidates[best]))]

    def swaps(self) -> list[Move]:
        """
        Return, for every feature, the swap with its best neighbour and the change of the score.

        With H = G^-1 and u = H g for a candidate with products g, dropping feature k adds
        u_k^2 / H_kk to the candidate's squared length outside the support, and u_k x_k / H_kk to
        its product with the residual.
        """
        near = neighbours_of(self.support, self.n_joints)
        near[~self.usable[near] | np.isin(near, self.support)] = -1
        candidates = np.unique(near[near >= 0])
        if not candidates.size:
            return []
        cross = self.gram.between(self.support, candidates)
        u, spread = self.inverse @ cross, np.diag(self.inverse)
        outside = 1.0 - np.einsum('ij,ij->j', cross, u)
        correlation = self.correlation[candidates]
        row, column = np.nonzero(near >= 0)
        place = np.searchsorted(candidates, near[row, column])
        own = u[row, place] / spread[row]
        gain = _gains(correlation[place] + own * self.x[row],
                      outside[place] + own * u[row, place])
        change = np.full(near.shape, np.inf)
        change[row, column] = (self._losses() - self.costs[self.support])[row] + self.costs[
            candidates[place]] - gain
        best = np.argmin(change, axis=1)
        return [(float(change[k, j]), np.append(np.delete(self.support, k), near[k, j]))
                for k, j in enumerate(best) if np.isfinite(change[k, j])]

    def _losses(self) -> FloatArray:
        return self.x ** 2 / np.maximum(np.diag(self.inverse), 1e-300)

    def _independent(self, support: IntArray) -> IntArray:
        """Return a linearly independent subset of a support, preferring cheap features."""
        order = support[np.argsort(self.costs[support], kind='stable')]
        gram = self.gram.within(order)
        factor, failed = linalg.lapack.dpotrf(gram, lower=True) if order.size else (gram, 0)
        if not failed and (np.diag(factor) ** 2 > _DEPENDENT).all():
            return np.sort(order)
        kept: list[int] = []
        factor = np.zeros((0, 0))
        for k in range(len(order)):
            row = linalg.solve_triangular(factor, gram[kept, k], lower=True,
                                          check_finite=False) if kept else np.zeros(0)
            outside = gram[k, k] - row @ row
            if outside > _DEPENDENT:
                factor = np.block([[factor, np.zeros((len(kept), 1))],
                                   [row[None, :], np.sqrt(outside)]])
                kept.append(k)
        return np.sort(order[kept])


def _gains(correlation: FloatArray, outside: FloatArray) -> FloatArray:
    """Return the decrease of chi^2 by candidates, from their parts outside the support."""
    return np.where(outside > _DEPENDENT, correlation ** 2 / np.maximum(outside, _DEPENDENT), 0.0)


def _largest(values: FloatArray, count: int) -> IntArray:
    """Return the ascending indices of the largest finite values."""
    count = min(count, int(np.isfinite(values).sum()))
    return np.sort(np.argpartition(-values, count - 1)[:count]) if count else np.zeros(
        0, dtype=np.int64)
