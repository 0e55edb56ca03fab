"""
Weighted least squares of gravity and effects together, with folds left out.

All joints share the gravity step; effects add columns to one joint or several. Products of
columns are summed fold by fold, so that a fit without a fold is a difference of small matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.estimation.gravity_step import Part
from gravity_comp_ros.evaluation.blocks import Blocks
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np
from scipy import linalg

# Ridge relative to each column's own length: settles what is exactly dependent.
_RIDGE = 1e-10


@dataclass(frozen=True)
class Prior:
    """What is known before the data: each unknown (P,) lies near `centre`, with `information`."""

    information: FloatArray
    centre: FloatArray

    @staticmethod
    def joined(parts: Sequence[Prior]) -> Prior:
        """Return the prior of several groups of unknowns, one group after another."""
        return Prior(np.concatenate([part.information for part in parts]),
                     np.concatenate([part.centre for part in parts]))


class System:
    """
    Targets y (M, N) = columns times P unknowns + noise.

    :param parts: per joint, the columns and the unknowns that they belong to.
    :param sigma: the standard deviation (N,) of each joint's noise.
    :param fold: the fold (M,) of each sample, from 0 to `n_folds` - 1.
    """

    def __init__(self, parts: list[Part], y: FloatArray, sigma: FloatArray, prior: Prior,
                 fold: IntArray, n_folds: int) -> None:
        self.parts, self.y, self.sigma, self.prior, self.fold = parts, y, sigma, prior, fold
        size = len(prior.centre)
        gram, c = np.zeros((n_folds, size, size)), np.zeros((n_folds, size))
        for f in range(n_folds):
            rows = fold == f
            for n, part in enumerate(parts):
                x = part.columns[rows] / sigma[n]
                gram[f][np.ix_(part.unknowns, part.unknowns)] += x.T @ x
                c[f][part.unknowns] += x.T @ (y[rows, n] / sigma[n])
        # The fit of number f leaves fold f out; the last one uses all.
        self._gram = np.concatenate([gram.sum(axis=0) - gram, gram.sum(axis=0)[None]])
        self._c = np.concatenate([c.sum(axis=0) - c, c.sum(axis=0)[None]])

    def solve(self, which: int = -1) -> FloatArray:
        """Return the unknowns (P,) fitted without fold `which`, or to everything (-1)."""
        matrix = self._matrix(which)
        right = self._c[which] + self.prior.information * self.prior.centre
        try:
            return np.asarray(linalg.cho_solve(linalg.cho_factor(matrix), right))
        except linalg.LinAlgError:
            return np.asarray(lstsq(matrix, right))

    def residual(self, x: FloatArray) -> FloatArray:
        """Return what unknowns x leave, (M, N) in N·m."""
        return self.y - np.column_stack([part.columns @ x[part.unknowns]
                                         for part in self.parts])

    def training_error(self, which: int) -> float:
        """Return the squared error of fit `which` where it was fitted, in units of noise."""
        x = self.solve(which)
        rows = self.fold != which if which >= 0 else np.ones(len(self.y), dtype=bool)
        return float(((self.residual(x)[rows] / self.sigma) ** 2).sum())

    def covariance(self, blocks: Blocks) -> FloatArray:
        """
        Return how far the fit to everything may be off, (P, P), robust to correlated noise.

        The sandwich A^-1 (sum_b s_b s_b.T) A^-1 with the blocks' scores s_b, and the prior's
        information added to the middle as it stands (Liang and Zeger 1986).
        """
        rest = self.residual(self.solve()) / self.sigma
        scores = np.zeros((blocks.count, len(self.prior.centre)))
        for n, part in enumerate(self.parts):
            scores[:, part.unknowns] += blocks.sums(part.columns * (rest[:, n] / self.sigma[n]
                                                                    )[:, None])
        b = blocks.count
        meat = scores.T @ scores * b / max(b - 1, 1) + np.diag(self.prior.information)
        inverse = linalg.pinvh(self._matrix(-1))
        return np.asarray(inverse @ meat @ inverse)

    def _matrix(self, which: int) -> FloatArray:
        matrix = self._gram[which] + np.diag(self.prior.information)
        own = np.diag(matrix)
        return np.asarray(matrix + np.diag(np.maximum(_RIDGE * own, 1e-12)))
