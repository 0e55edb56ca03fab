"""Normal prior of the shared coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
import numpy as np
from scipy.linalg import solve_triangular


@dataclass(frozen=True, eq=False)
class Prior:
    """
    Coefficients `mean` + `root` z, z standard normal.

    `mean` (P,), `root` (P, P) lower triangular: a factor of the covariance.
    """

    mean: FloatArray
    root: FloatArray

    @classmethod
    def independent(cls, mean: FloatArray, std: FloatArray) -> Prior:
        """Return the prior of independent coefficients, means and standard deviations (P,)."""
        return cls(mean, np.diag(std))

    def narrow(self, count: int, factor: float) -> Prior:
        """Return the prior with the first coefficients narrowed by a factor."""
        root = self.root.copy()
        root[:count] *= factor
        return Prior(self.mean, root)

    @cached_property
    def precision(self) -> FloatArray:
        """Return the inverse (P, P) of the covariance."""
        inverse = self.whitened(np.eye(len(self.mean)))
        return np.asarray(inverse.T @ inverse)

    @cached_property
    def log_det(self) -> float:
        """Return the logarithm of the determinant of `precision`."""
        return float(-2.0 * np.log(np.abs(np.diag(self.root))).sum())

    def whitened(self, change: FloatArray) -> FloatArray:
        """Return z (P, ...) of a difference (P, ...) from the mean."""
        return np.asarray(solve_triangular(self.root, change, lower=True))
