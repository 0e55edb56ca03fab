"""Physical scales of an arm in a recording, and the normal prior of the shared coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.regression.options import EngineOptions
import numpy as np
from scipy.linalg import solve_triangular

# Share of samples below the torque scale: single spikes do not set it.
_QUANTILE = 0.995


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

    def wider(self, std: FloatArray) -> Prior:
        """Return the prior with standard deviations (K,) added to its first K coefficients."""
        root, first = self.root.copy(), np.arange(len(std))
        root[first, first] = np.hypot(root[first, first], std)
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


@dataclass(frozen=True, eq=False)
class Scale:
    """
    Scales of N joints.

    `torque` (N,) in N·m is each joint's torque scale, `largest` the largest of them; `low` and
    `high` (N,) in rad are the range of the angles.
    """

    torque: FloatArray
    largest: float
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, samples: JointSamples, options: EngineOptions) -> Scale:
        """Return the scales of samples."""
        size = np.quantile(np.abs(samples.tau), _QUANTILE, axis=0)
        largest = max(float(size.max(initial=0.0)), 1e-9)
        return cls(np.maximum(size, options.min_scale * largest), largest,
                   samples.q.min(axis=0), samples.q.max(axis=0))
