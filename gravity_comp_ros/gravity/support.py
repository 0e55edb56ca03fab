"""
Settle the support: which features stay, once the L1 problem has proposed some.

Over a small motion many features look alike, and the L1 norm takes any of them. What tells them
apart outside that motion is simplicity: the feature with fewer factors is the likelier one. The
score is a description length, twice the negative log posterior of the support,

    score(S) = chi^2(S) + sum_{k in S} cost(k),    cost(k) = ln R + 2 (-ln P(k)),

where chi^2 is the weighted residual after an unpenalised fit, ln R prices a coefficient as BIC
does, and P(k) is a prior over features in which each joint takes the factor 1 with probability
2/3, sin and cos with 1/6 each. It sums to one over all 3^N features, so that it also pays for
the many that were tried. Steps that lower the score are taken: leave a feature out, else add
one, else put a neighbour (one factor changed) in the place of one.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.gravity.design import Design
from gravity_comp_ros.gravity.lasso import column_lengths, has_length
from gravity_comp_ros.samples import BoolArray, FloatArray, IntArray
import numpy as np
from scipy import linalg

_P_ONE = 2.0 / 3.0
_P_SIN_OR_COS = 1.0 / 6.0
_MAX_STEPS = 400
# A step must lower the score by more than rounding does.
_PAYS = 1e-6
# How many features are looked at for an addition.
_CANDIDATES = 30
# Models whose score is within this of the best (a posterior ratio of 1 to 50) are averaged.
_TIE = 8.0
# A column of which less than this share (of its squared length) lies outside the span of the
# support adds nothing: what is left of it is rounding.
_DEPENDENT = 1e-8

# What a step changes in the score, and the support that it leads to.
Move = tuple[float, IntArray]


@dataclass(frozen=True)
class Refit:
    """An unpenalised weighted fit on a support: coefficients, covariance and chi^2."""

    indices: IntArray
    x: FloatArray
    covariance: FloatArray
    chi2: float

    @classmethod
    def empty(cls) -> Refit:
        """Return the fit on no features, before any data was seen."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 0)), np.inf)


def costs(n_joints: int, n_rows: int) -> FloatArray:
    """Return the price of every feature in units of chi^2, shape (3^N,)."""
    factor = -2.0 * np.log([_P_ONE, _P_SIN_OR_COS, _P_SIN_OR_COS])
    price = np.array([np.log(max(n_rows, 2))])
    for _ in range(n_joints):
        price = (price[:, None] + factor).ravel()
    return price


def refit(design: Design, b: FloatArray, indices: IntArray) -> Refit:
    """
    Fit b on the chosen columns without a penalty, which undoes the shrinkage of L1.

    Columns that depend on each other get the least coefficients that fit.
    """
    indices = np.sort(np.asarray(indices, dtype=np.int64))
    if not indices.size:
        return Refit(indices, np.zeros(0), np.zeros((0, 0)), float(b @ b))
    a = design.columns(indices)
    lengths = np.linalg.norm(a, axis=0)
    lengths[lengths == 0.0] = 1.0
    u, s, vt = linalg.svd(a / lengths, full_matrices=False, check_finite=False)
    keep = s > 1e-12 * s[0]
    half = vt[keep].T / s[keep]
    x = half @ (u[:, keep].T @ b) / lengths
    covariance = (half @ half.T) / np.outer(lengths, lengths)
    residual = b - a @ x
    return Refit(indices, x, covariance, float(residual @ residual))


def neighbours(index: int, n_joints: int) -> IntArray:
    """Return the features that differ from one in a single factor."""
    powers = 3 ** np.arange(n_joints - 1, -1, -1, dtype=np.int64)
    factors = (index // powers) % 3
    base = index - factors * powers
    near = np.concatenate([base, base + powers, base + 2 * powers])
    return np.unique(near[near != index])


def settle(design: Design, b: FloatArray, indices: IntArray, n_joints: int,
           usable: BoolArray) -> Refit:
    """
    Return the support of least description length that single steps reach from `indices`.

    :param usable: mask over all features; the others are never proposed.
    """
    search = _Search(design, b, n_joints, usable, np.asarray(indices, dtype=np.int64))
    for _ in range(_MAX_STEPS):
        if not search.step():
            break
    return refit(design, b, search.support)


def score(refit: Refit, n_joints: int, n_rows: int) -> float:
    """Return the description length of a refitted support (module docstring)."""
    return refit.chi2 + float(costs(n_joints, n_rows)[refit.indices].sum())


def average_ties(design: Design, b: FloatArray, best: Refit, n_joints: int,
                 usable: BoolArray) -> tuple[Refit, int]:
    """
    Return the average of the best support with the single swaps that nearly tie with it.

    Each model weighs exp(-score / 2), its posterior probability: where the data cannot tell two
    features apart, the average halves what the wrong one would do outside the trained range.
    The covariance holds the spread within and between the models.

    :return: the average and how many other models went into it.
    """
    search = _Search(design, b, n_joints, usable, best.indices)
    near = [refit(design, b, other) for change, other in search.swaps() if change < _TIE]
    models = [best] + near
    # From the refits, because what the search promises is rounded (`_Search.step`).
    scores = np.array([score(model, n_joints, design.n_rows) for model in models])
    weights = np.exp(-0.5 * (scores - scores.min()))
    return _mixture(models, weights / weights.sum(), best.chi2), len(near)


def _mixture(models: list[Refit], weights: FloatArray, chi2: float) -> Refit:
    indices = np.unique(np.concatenate([m.indices for m in models]))
    xs = np.zeros((len(models), len(indices)))
    within = np.zeros((len(indices), len(indices)))
    for k, (model, weight) in enumerate(zip(models, weights)):
        here = np.searchsorted(indices, model.indices)
        xs[k, here] = model.x
        within[np.ix_(here, here)] += weight * model.covariance
    mean = weights @ xs
    spread = xs - mean
    return Refit(indices, mean, within + (spread.T * weights) @ spread, chi2)


class _Search:
    """The support and the columns seen so far, with their Gram matrix; all of unit length."""

    def __init__(self, design: Design, b: FloatArray, n_joints: int, usable: BoolArray,
                 support: IntArray) -> None:
        self.design, self.b, self.n_joints = design, b, n_joints
        self.lengths = column_lengths(design)
        self.usable = usable & has_length(self.lengths)
        self.costs = costs(n_joints, design.n_rows)
        self.pool = np.zeros(0, dtype=np.int64)
        self.place_of = np.full(design.n_columns, -1, dtype=np.int64)
        self.columns = np.zeros((design.n_rows, 0))
        self.gram = np.zeros((0, 0))
        self.c = np.zeros(0)
        self.change_support(np.sort(support[self.usable[support]]))

    def change_support(self, support: IntArray) -> None:
        """Take a support, leaving out what its other features already span."""
        self._admit(support)
        self.support = self._independent(support)
        self.place = self.place_of[self.support]
        self.inverse = linalg.inv(self.gram[np.ix_(self.place, self.place)],
                                  check_finite=False) if len(self.place) else np.zeros((0, 0))
        self.x = self.inverse @ self.c[self.place]
        self.residual = self.b - self.columns[:, self.place] @ self.x
        self.score = float(self.residual @ self.residual + self.costs[self.support].sum())

    def step(self) -> bool:
        """
        Take the best drop, else the best addition, else the best swap that pays.

        What a move promises comes from the Gram matrix, whose rounding can exceed the noise
        where columns look alike; so a move that does not keep its promise is taken back.
        """
        before, here = self.score, self.support
        for moves in (self.drops, self.additions, self.swaps):
            change, support = min(moves(), key=lambda move: move[0], default=(0.0, None))
            if support is None or change >= -_PAYS:
                continue
            self.change_support(np.sort(support))
            if self.score < before:
                return True
            self.change_support(here)
        return False

    def drops(self) -> list[Move]:
        """Return what leaving out each feature changes: chi^2 rises by x_k^2 / (G^-1)_kk."""
        change = self._losses() - self.costs[self.support]
        return [(float(change[k]), np.delete(self.support, k)) for k in range(len(change))]

    def additions(self) -> list[Move]:
        """Return what adding each of the most promising features changes."""
        correlation = np.where(self.usable, self.design.correlate(self.residual), 0.0)
        correlation = correlation / np.where(self.usable, self.lengths, 1.0)
        promise = np.where(self.usable, correlation ** 2 - self.costs, -np.inf)
        promise[self.support] = -np.inf
        candidates = _largest(promise, _CANDIDATES)
        self._admit(candidates)
        gain = self._gains(candidates, self.place, self.inverse, correlation[candidates])
        change = self.costs[candidates] - gain
        return [(float(c), np.append(self.support, k)) for c, k in zip(change, candidates)]

    def swaps(self) -> list[Move]:
        """Return, for every feature, the best neighbour in its place and what it changes."""
        near = [self._outside_support(neighbours(int(k), self.n_joints)) for k in self.support]
        if near:
            self._admit(np.unique(np.concatenate(near)))
        losses, moves = self._losses(), []
        for k, candidates in enumerate(near):
            if not candidates.size:
                continue
            rest = np.delete(np.arange(len(self.place)), k)
            # The inverse without row and column k, from the one with them (Schur).
            inverse = self.inverse[np.ix_(rest, rest)] - np.outer(
                self.inverse[rest, k], self.inverse[k, rest]) / self.inverse[k, k]
            place, here = self.place[rest], self.place_of[candidates]
            x = inverse @ self.c[place]
            correlation = self.c[here] - self.gram[np.ix_(here, place)] @ x
            gain = self._gains(candidates, place, inverse, correlation)
            change = (losses[k] - self.costs[self.support[k]]
                      + self.costs[candidates] - gain)
            best = int(np.argmin(change))
            moves.append((float(change[best]), np.append(np.delete(self.support, k),
                                                         candidates[best])))
        return moves

    def _losses(self) -> FloatArray:
        return self.x ** 2 / np.maximum(np.diag(self.inverse), 1e-300)

    def _gains(self, candidates: IntArray, place: IntArray, inverse: FloatArray,
               correlation: FloatArray) -> FloatArray:
        """Return by how much each candidate lowers chi^2 beside the columns at `place`."""
        cross = self.gram[np.ix_(place, self.place_of[candidates])]
        outside = 1.0 - np.einsum('ij,ij->j', cross, inverse @ cross)
        return np.where(outside > _DEPENDENT,
                        correlation ** 2 / np.maximum(outside, _DEPENDENT), 0.0)

    def _outside_support(self, indices: IntArray) -> IntArray:
        return indices[self.usable[indices] & ~np.isin(indices, self.support)]

    def _independent(self, support: IntArray) -> IntArray:
        """Keep the simple features of a set in which some depend on others."""
        if not support.size:
            return support
        order = support[np.argsort(self.costs[support], kind='stable')]
        place = self.place_of[order]
        gram = self.gram[np.ix_(place, place)]
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

    def _admit(self, indices: IntArray) -> None:
        """Compute columns that have not been seen, and their products with the others."""
        new = indices[self.place_of[indices] < 0]
        if not new.size:
            return
        fresh = self.design.columns(new) / self.lengths[new]
        cross = self.columns.T @ fresh
        self.gram = np.block([[self.gram, cross], [cross.T, fresh.T @ fresh]])
        self.columns = np.hstack([self.columns, fresh])
        self.c = np.concatenate([self.c, fresh.T @ self.b])
        self.place_of[new] = len(self.pool) + np.arange(len(new))
        self.pool = np.concatenate([self.pool, new])


def _largest(values: FloatArray, count: int) -> IntArray:
    """Return where the largest finite values are, rising by index."""
    count = min(count, int(np.isfinite(values).sum()))
    return np.sort(np.argpartition(-values, count - 1)[:count]) if count else np.zeros(
        0, dtype=np.int64)
