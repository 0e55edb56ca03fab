"""
Selection of the support by description length, among the working set of the L1 problem.

Over a small motion many features are nearly collinear, and the L1 norm selects any of them. A
prior distinguishes them outside that motion: the feature with fewer factors is more probable. The
score is a description length, twice the negative log posterior of the support,

    score(S) = chi^2(S) + sum_{k in S} cost(k),    cost(k) = ln R + 2 (-ln P(k)),

where chi^2 is the weighted sum of squares after an unpenalised fit, ln R the price of a
coefficient in BIC, and P(k) a prior over features in which each joint has the factor 1 with
probability 2/3, sin and cos with 1/6 each. It sums to one over all 3^N features, so it also
accounts for the number of features tried. The best drop, addition or swap is taken while it lowers
the score.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.sparse.lasso import LassoProblem
import numpy as np
from scipy.linalg.lapack import dpstrf

_P_ONE, _P_SIN_OR_COS = 2.0 / 3.0, 1.0 / 6.0
_MAX_STEPS = 400
# Minimum decrease of the score by a step, above rounding.
_MIN_DECREASE = 1e-6
# Supports whose score is within this of the best (a posterior ratio of 1 to 50) are equivalent.
_EQUIVALENT = 8.0
# A column is linearly dependent if less than this share of its squared length lies outside the
# span of the support.
_DEPENDENT = 1e-8


@dataclass(frozen=True, eq=False)
class Support:
    """
    Features `indices` (K,) with the coefficients `x` of an unpenalised fit, and its score.

    `equivalent` are the features that could replace one of them at nearly the same score.
    """

    indices: IntArray
    x: FloatArray
    score: float
    equivalent: IntArray


def costs(n_joints: int, n_rows: int) -> FloatArray:
    """Return the price of every feature in chi^2, shape (3^N,)."""
    factor = -2.0 * np.log([_P_ONE, _P_SIN_OR_COS, _P_SIN_OR_COS])
    price = np.array([np.log(max(n_rows, 2))])
    for _ in range(n_joints):
        price = (price[:, None] + factor).ravel()
    return price


def select_support(problem: LassoProblem, n_joints: int, *starts: IntArray) -> Support:
    """
    Return the support of smallest score that single steps from the starts reach.

    :param problem: a solved one; usable features of the starts join its working set.
    """
    search = _Search(problem, n_joints, np.concatenate(starts))
    return min((search.result(start) for start in starts), key=lambda each: each.score)


class _Search:
    """Supports within the working set of an L1 problem, as numbers (K,) within the set."""

    def __init__(self, problem: LassoProblem, n_joints: int, more: IntArray) -> None:
        self.indices, self.columns, self.scale = problem.working_set(more)
        self.b, self.price = problem.b, costs(n_joints, len(problem.b))[self.indices]
        self.gram, self.c = self.columns @ self.columns.T, self.columns @ self.b

    def result(self, start: IntArray) -> Support:
        """Return the support that no step from the independent features of a start improves."""
        inside = self._independent(np.flatnonzero(np.isin(self.indices, start)))
        x, score = self._solved(inside)
        for _ in range(_MAX_STEPS):
            changed = min(self._steps(inside, x), key=lambda step: step[0])[1]
            tried = self._solved(changed)
            # Predicted scores have rounding errors, large ones for nearly collinear columns.
            if tried[1] > score - _MIN_DECREASE:
                break
            inside, (x, score) = changed, tried
        order = np.argsort(self.indices[inside])
        return Support(self.indices[inside][order], (self.scale[inside] * x)[order], score,
                       self._equivalent(inside, x))

    def _solved(self, inside: IntArray) -> tuple[FloatArray, float]:
        """Return the coefficients (K,) of unit columns, and the score."""
        x = np.linalg.solve(self.gram[np.ix_(inside, inside)], self.c[inside])
        residual = self.b - x @ self.columns[inside]
        return np.asarray(x), float(residual @ residual + self.price[inside].sum())

    def _steps(self, inside: IntArray, x: FloatArray) -> list[tuple[float, IntArray]]:
        """Return the best drop, addition and swap: the change of the score, and the support."""
        drops, outside, additions, swaps = self._changes(inside, x)
        steps = [(0.0, inside)]
        if len(inside):
            k = int(drops.argmin())
            steps.append((float(drops[k]), np.delete(inside, k)))
        if len(outside):
            j = int(additions.argmin())
            steps.append((float(additions[j]), np.append(inside, outside[j])))
        if swaps.size:
            k, j = divmod(int(swaps.argmin()), len(outside))
            steps.append((float(swaps[k, j]), np.append(np.delete(inside, k), outside[j])))
        return steps

    def _changes(self, inside: IntArray, x: FloatArray
                 ) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
        """
        Return the changes of the score by drops (K,), additions (L,) and swaps (K, L).

        The second result are the L features outside. With H = G^-1, and u = H g for a candidate of
        products g, dropping feature k adds u_k^2 / H_kk to the candidate's squared length outside
        the support, and u_k x_k / H_kk to its product with the residual.
        """
        outside = np.setdiff1d(np.arange(len(self.indices)), inside)
        inverse = np.linalg.inv(self.gram[np.ix_(inside, inside)])
        cross, spread = self.gram[np.ix_(inside, outside)], np.diag(inverse)
        u = inverse @ cross
        rest = 1.0 - (cross * u).sum(axis=0)
        correlation = self.c[outside] - x @ cross
        own, price = u / spread[:, None], self.price[outside]
        drops = x ** 2 / spread - self.price[inside]
        swaps = drops[:, None] + price - _gains(correlation + own * x[:, None], rest + own * u)
        return drops, outside, price - _gains(correlation, rest), swaps

    def _equivalent(self, inside: IntArray, x: FloatArray) -> IntArray:
        """Return the best feature to replace each of a support, where the score hardly rises."""
        _, outside, _, swaps = self._changes(inside, x)
        if not swaps.size:
            return np.zeros(0, dtype=np.int64)
        best = swaps.argmin(axis=1)[swaps.min(axis=1) < _EQUIVALENT]
        return np.unique(self.indices[outside[best]])

    def _independent(self, inside: IntArray) -> IntArray:
        """Return a maximal set of linearly independent features."""
        if not len(inside):
            return inside
        _, order, rank, _ = dpstrf(self.gram[np.ix_(inside, inside)], tol=_DEPENDENT)
        return inside[order[:rank] - 1]


def _gains(correlation: FloatArray, rest: FloatArray) -> FloatArray:
    """Return the decrease of chi^2 by candidates, from their parts outside the support."""
    return np.where(rest > _DEPENDENT, correlation ** 2 / np.maximum(rest, _DEPENDENT), 0.0)
