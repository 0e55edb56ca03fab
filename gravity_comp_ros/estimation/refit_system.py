"""
Weighted least squares of gravity and effects together, with each fold left out.

All joints share the gravity step; an effect adds columns to one joint or several. Products of
columns are summed fold by fold, so that a fit without one fold uses a difference of small
matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.estimation.gravity_step import Part
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np
from scipy import linalg

# Ridge relative to each column's squared norm, for linearly dependent columns.
_RIDGE = 1e-10


@dataclass(frozen=True)
class Prior:
    """Gaussian prior of each unknown (P,): its `centre`, and its `information` 1 / std^2."""

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

    :param parts: per joint, the columns and the indices of their unknowns.
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
        # Fit number f leaves fold f out; the last one uses all.
        self._gram = np.concatenate([gram.sum(axis=0) - gram, gram.sum(axis=0)[None]])
        self._c = np.concatenate([c.sum(axis=0) - c, c.sum(axis=0)[None]])

    def solve(self, fit: int = -1) -> FloatArray:
        """Return the unknowns (P,) fitted without fold `fit`, or to all samples (-1)."""
        matrix = self._gram[fit] + np.diag(self.prior.information)
        matrix = matrix + np.diag(np.maximum(_RIDGE * np.diag(matrix), 1e-12))
        right = self._c[fit] + self.prior.information * self.prior.centre
        try:
            return np.asarray(linalg.cho_solve(linalg.cho_factor(matrix), right))
        except linalg.LinAlgError:
            return np.asarray(lstsq(matrix, right))

    def residual(self, x: FloatArray) -> FloatArray:
        """Return the residual (M, N) in N·m of unknowns x (P,)."""
        return self.y - np.column_stack([part.columns @ x[part.unknowns]
                                         for part in self.parts])

    def training_error(self, fit: int) -> float:
        """Return the squared error of a fit on its own samples, in units of the noise."""
        x = self.solve(fit)
        rows = self.fold != fit if fit >= 0 else np.ones(len(self.y), dtype=bool)
        return float(((self.residual(x)[rows] / self.sigma) ** 2).sum())
