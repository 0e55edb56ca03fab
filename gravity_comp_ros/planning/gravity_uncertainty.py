"""
Standard deviation of the gravity torque, before and after a planned motion.

The parameters of the model have the covariance C = L L.T. With J_n the derivative of the torque of
joint n by them, its standard deviation is |L.T J_n.T|. A motion with information I, nuisance terms
projected out, reduces the covariance to L (1 + L.T I L)^-1 L.T. The criterion is the mean square
over the recorded poses (V-optimality).
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import evenly_picked, FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.gravity_parameters import covariance_columns
import numpy as np

# Poses at which the standard deviation is evaluated.
_POSES = 300
# Smallest share of the variance of a parameter direction that is kept.
_MIN_SHARE = 1e-9
# Prior information on nuisance terms.
_NUISANCE_PRIOR = 1e-6
# A joint is uncertain if its standard deviation exceeds this share of its torque range, and this
# multiple of its noise.
_MIN_OF_RANGE, _MIN_OF_NOISE = 0.01, 0.5


@dataclass(frozen=True)
class GravityScore:
    """Standard deviations `std` of the uncertain joints in N·m with a motion, `before` without."""

    std: FloatArray
    before: FloatArray

    @property
    def utility(self) -> float:
        """Return the mean logarithm of the factor by which the standard deviation falls."""
        return float(np.log(self.before / np.maximum(self.std, 1e-12)).mean())


@dataclass(frozen=True, eq=False)
class GravityUncertainty:
    """
    Gravity uncertainty of a model over poses.

    `joints` are the uncertain ones, largest standard deviation first. `factor` (K, R) is L,
    `mean_square` (N, R, R) the mean over the poses of the outer products of L.T J_n.T.
    """

    model: GravityModel
    joints: tuple[int, ...]
    factor: FloatArray
    mean_square: FloatArray

    def zero_information(self) -> FloatArray:
        n = self.model.n_joints
        return np.zeros((self.factor.shape[1] + n * (n + 3),) * 2)

    def information(self, q: FloatArray, nuisance: FloatArray, weights: FloatArray) -> FloatArray:
        """
        Return the information of poses q (M, N) on parameters and nuisance terms.

        :param nuisance: nuisance columns (M, N, N + 3) of each joint.
        :param weights: (N,) in 1/(N·m)² per row.
        """
        total, r = self.zero_information(), self.factor.shape[1]
        columns = covariance_columns(self.model, q) @ self.factor
        for n, weight in enumerate(weights):
            own = slice(r + n * nuisance.shape[2], r + (n + 1) * nuisance.shape[2])
            a, b = columns[:, n], nuisance[:, n]
            cross = weight * (a.T @ b)
            total[:r, :r] += weight * (a.T @ a)
            total[:r, own] += cross
            total[own, :r] += cross.T
            total[own, own] += weight * (b.T @ b)
        return total

    def score(self, information: FloatArray) -> GravityScore:
        """Return the standard deviations of the uncertain joints with this information."""
        r = self.factor.shape[1]
        nuisance = information[r:, r:] + _NUISANCE_PRIOR * np.eye(len(information) - r)
        cross = information[:r, r:]
        marginal = information[:r, :r] - cross @ np.linalg.solve(nuisance, cross.T)
        covariance = np.asarray(np.linalg.inv(np.eye(r) + 0.5 * (marginal + marginal.T)))
        return GravityScore(self._std(covariance), self._std(np.eye(r)))

    def _std(self, covariance: FloatArray) -> FloatArray:
        variance = np.einsum('ij,nji->n', covariance, self.mean_square[list(self.joints)])
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def gravity_uncertainty(model: GravityModel, q: FloatArray, tau: FloatArray, noise: FloatArray,
                        all_joints: bool = False) -> GravityUncertainty | None:
    """
    Return the gravity uncertainty over poses q (M, N); None if no joint or model reports any.

    :param tau: measured torque (M, N). :param noise: its white noise (N,) in N·m.
    :param all_joints: include every joint, however small its standard deviation.
    """
    if model.uncertainty is None:
        return None
    q = q[evenly_picked(len(q), _POSES)]
    values, vectors = np.linalg.eigh(model.uncertainty.covariance)
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    columns = covariance_columns(model, q) @ factor
    share = (columns ** 2).sum(axis=(0, 1))
    kept = share > _MIN_SHARE * max(float(share.sum()), 1e-300)
    columns = columns[:, :, kept]
    mean_square = np.einsum('pni,pnj->nij', columns, columns) / len(q)
    std = np.sqrt(np.einsum('nii->n', mean_square))
    limit = np.maximum(_MIN_OF_RANGE * np.ptp(tau, axis=0), _MIN_OF_NOISE * noise)
    joints = [int(n) for n in np.argsort(-std) if all_joints or std[n] > limit[n]]
    return (GravityUncertainty(model, tuple(joints), factor[:, kept], mean_square)
            if joints else None)
