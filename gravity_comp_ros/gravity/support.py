"""
Settle the support: which features stay, once the L1 problem has proposed some.

Over a small motion many features look alike, and the L1 norm takes any of them. What tells them
apart outside that motion is simplicity: the feature with fewer factors is the likelier one. The
score is a description length, twice the negative log posterior of the support,

    score(S) = chi^2(S) + sum_{k in S} cost(k),    cost(k) = ln R + 2 (-ln P(k)),

where chi^2 is the weighted residual after an unpenalised fit, ln R prices a coefficient as BIC
does, and P(k) is a prior over features in which each joint takes the factor 1 with probability
2/3, sin and cos with 1/6 each. It sums to one over all 3^N features, so that it also pays for
the many that were tried. Steps that lower the score are taken, the best first: leave a feature
out, put a neighbour (one factor changed) in its place, or add a feature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from gravity_comp_ros.gravity import dictionary
from gravity_comp_ros.gravity.design import Design
from gravity_comp_ros.gravity.lasso import column_lengths, has_length
from gravity_comp_ros.samples import BoolArray, FloatArray, IntArray

_P_ONE = 2.0 / 3.0
_P_SIN_OR_COS = 1.0 / 6.0
_MAX_STEPS = 200
# Models whose score is within this of the best (a posterior ratio of 1 to 50) are averaged.
_TIE = 8.0
# Columns whose part outside the support's span is shorter than this (relative) add nothing.
_DEPENDENT = 1e-10


@dataclass(frozen=True)
class Refit:
    """An unpenalised weighted fit on a support: coefficients, covariance and chi^2."""

    indices: IntArray
    x: FloatArray
    covariance: FloatArray
    chi2: float


def costs(indices: IntArray, n_joints: int, n_rows: int) -> FloatArray:
    """Return the price of each feature in units of chi^2."""
    degree = (dictionary.digits(indices, n_joints) != dictionary.ONE).sum(axis=1)
    surprise = -(n_joints - degree) * np.log(_P_ONE) - degree * np.log(_P_SIN_OR_COS)
    return np.log(max(n_rows, 2)) + 2.0 * surprise


def refit(design: Design, b: FloatArray, indices: IntArray) -> Refit:
    """
    Fit b on the chosen columns without a penalty, which undoes the shrinkage of L1.

    Columns that depend on each other get the least coefficients that fit.
    """
    indices = np.sort(np.asarray(indices, dtype=np.int64))
    a = design.columns(indices)
    lengths = np.linalg.norm(a, axis=0)
    lengths[lengths == 0.0] = 1.0
    u, s, vt = linalg.svd(a / lengths, full_matrices=False, check_finite=False)
    keep = s > _DEPENDENT * s[0] if s.size else np.zeros(0, dtype=bool)
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
    return refit.chi2 + float(costs(refit.indices, n_joints, n_rows).sum())


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
    place = search._places(search.support)
    inverse, x = search._solve(place)
    if inverse is None or not len(best.indices):
        return best, 0
    price = costs(search.support, n_joints, design.n_rows)
    loss = x ** 2 / np.maximum(np.diag(inverse), 1e-300)
    near = [(change, move) for change, move in search._swaps(inverse, x, loss, price)
            if change < _TIE]
    models = [best] + [refit(design, b, np.append(np.delete(search.support, move[1]), move[2]))
                       for _, move in near]
    weights = np.exp(-0.5 * np.array([0.0] + [change for change, _ in near]))
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
    """The support and the columns seen so far, with their Gram matrix."""

    def __init__(self, design: Design, b: FloatArray, n_joints: int, usable: BoolArray,
                 support: IntArray) -> None:
        self.design, self.b, self.n_joints = design, b, n_joints
        self.support = np.sort(support)
        self.lengths = column_lengths(design)
        self.usable = usable & has_length(self.lengths)
        self.pool = np.zeros(0, dtype=np.int64)
        self.columns = np.zeros((design.n_rows, 0))
        self.gram = np.zeros((0, 0))
        self.c = np.zeros(0)
        self._admit(self.support)

    def step(self) -> bool:
        """Take the best step; return False when none lowers the score."""
        place = self._places(self.support)
        inverse, x = self._solve(place)
        if inverse is None:
            return self._drop_dependent(place)
        price = costs(self.support, self.n_joints, self.design.n_rows)
        variance = np.maximum(np.diag(inverse), 1e-300)
        # Leaving k out raises chi^2 by x_k^2 / (G^-1)_kk.
        loss = x ** 2 / variance
        drop = loss - price
        best, move = min((float(drop[k]), ('drop', k)) for k in range(len(price))) \
            if len(price) else (0.0, ('drop', -1))
        for change, candidate in self._swaps(inverse, x, loss, price):
            if change < best:
                best, move = change, candidate
        change, candidate = self._best_addition(place, x)
        if change < best:
            best, move = change, candidate
        if best >= -1e-9:
            return False
        self._apply(move)
        return True

    def _apply(self, move: tuple) -> None:
        kind = move[0]
        if kind == 'drop':
            self.support = np.delete(self.support, move[1])
        elif kind == 'swap':
            self.support = np.sort(np.append(np.delete(self.support, move[1]), move[2]))
        else:
            self.support = np.sort(np.append(self.support, move[1]))

    def _swaps(self, inverse: FloatArray, x: FloatArray, loss: FloatArray,
               price: FloatArray) -> list[tuple[float, tuple]]:
        """Return the best neighbour of every feature, with its change of the score."""
        near = [self._allowed(neighbours(int(k), self.n_joints)) for k in self.support]
        self._admit(np.unique(np.concatenate(near)) if near else self.pool[:0])
        place = self._places(self.support)
        found: list[tuple[float, tuple]] = []
        for k, candidates in enumerate(near):
            if not candidates.size:
                continue
            rest = np.delete(np.arange(len(place)), k)
            # The inverse without row and column k, from the one with them (Schur).
            part = inverse[np.ix_(rest, rest)] - np.outer(
                inverse[rest, k], inverse[k, rest]) / inverse[k, k]
            here = self._places(candidates)
            cross = self.gram[np.ix_(place[rest], here)]
            projected = part @ cross
            outside = np.diag(self.gram)[here] - np.einsum('ij,ij->j', cross, projected)
            x_rest = part @ self.c[place[rest]]
            inner = self.c[here] - cross.T @ x_rest
            gain = np.where(outside > 1e-7, inner ** 2 / np.maximum(outside, 1e-7), 0.0)
            change = loss[k] - gain + costs(candidates, self.n_joints,
                                            self.design.n_rows) - price[k]
            best = int(np.argmin(change))
            found.append((float(change[best]), ('swap', k, int(candidates[best]))))
        return found

    def _best_addition(self, place: IntArray, x: FloatArray) -> tuple[float, tuple]:
        """Return the feature whose correlation with the residual buys most, if it pays."""
        residual = self.b - self.columns[:, place] @ x
        correlation = self._unit(self.design.correlate(residual))
        correlation[self.support] = 0.0
        promise = correlation ** 2 - costs(np.arange(len(correlation)), self.n_joints,
                                           self.design.n_rows)
        promise[~self.usable] = -np.inf
        candidates = np.argsort(-promise, kind='stable')[:30]
        self._admit(np.sort(candidates))
        inverse, _ = self._solve(place)
        here = self._places(candidates)
        cross = self.gram[np.ix_(place, here)]
        outside = np.diag(self.gram)[here] - np.einsum('ij,ij->j', cross, inverse @ cross)
        gain = np.where(outside > 1e-7,
                        correlation[candidates] ** 2 / np.maximum(outside, 1e-7), 0.0)
        change = costs(candidates, self.n_joints, self.design.n_rows) - gain
        best = int(np.argmin(change))
        return float(change[best]), ('add', int(candidates[best]))

    def _drop_dependent(self, place: IntArray) -> bool:
        """Leave out the costliest feature that the others already span."""
        _, r, order = linalg.qr(self.columns[:, place], mode='economic', pivoting=True)
        weak = order[np.abs(np.diag(r)) <= 1e-7 * abs(r[0, 0])]
        if not weak.size:
            weak = order[-1:]
        price = costs(self.support[weak], self.n_joints, self.design.n_rows)
        self.support = np.delete(self.support, weak[int(np.argmax(price))])
        return True

    def _solve(self, place: IntArray) -> tuple[FloatArray | None, FloatArray]:
        gram = self.gram[np.ix_(place, place)]
        try:
            inverse = linalg.inv(gram, check_finite=False)
        except linalg.LinAlgError:
            return None, np.zeros(len(place))
        if not np.isfinite(inverse).all() or np.diag(inverse).max(initial=0.0) > 1e9:
            return None, np.zeros(len(place))
        return inverse, inverse @ self.c[place]

    def _allowed(self, indices: IntArray) -> IntArray:
        inside = self.usable[indices] & ~np.isin(indices, self.support)
        return indices[inside]

    def _unit(self, correlation: FloatArray) -> FloatArray:
        return np.where(self.usable, correlation / np.where(self.usable, self.lengths, 1.0),
                        0.0)

    def _admit(self, indices: IntArray) -> None:
        new = indices[~np.isin(indices, self.pool)]
        if not new.size:
            return
        fresh = self.design.columns(new) / self.lengths[new]
        cross = self.columns.T @ fresh
        self.gram = np.block([[self.gram, cross], [cross.T, fresh.T @ fresh]])
        self.columns = np.hstack([self.columns, fresh])
        self.c = np.concatenate([self.c, fresh.T @ self.b])
        self.pool = np.concatenate([self.pool, new])
        self._order = np.argsort(self.pool)

    def _places(self, indices: IntArray) -> IntArray:
        return self._order[np.searchsorted(self.pool[self._order], indices)]
