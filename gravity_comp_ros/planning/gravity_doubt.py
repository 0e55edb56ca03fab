"""
Where the gravity model is unsure, and what a motion does about it.

The model has the covariance C = L L.T of its parameters. Where the parameters move the torque of
joint n by J_n, its standard deviation is |L.T J_n.T|. A motion adds information I, nuisance terms
projected out, so that the covariance becomes L (1 + L.T I L)^-1 L.T. What counts is the mean
square over the poses of the user's own motion.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import evenly_picked, FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.uncertainty import EnergyUncertainty
import numpy as np

_POSES = 300
# Directions of the parameters that add less to the variance, as a share, are left out.
_LEAST = 1e-9
_NUISANCE = 1e-6
# A joint is unsure if the standard deviation exceeds this share of the range of its torque, and
# this many times the noise.
UNSURE, _ABOVE_NOISE = 0.01, 0.5


@dataclass(frozen=True)
class GravityAnswer:
    """`std` (N,) in N·m over the user's motion, and `before`, for the joints that are unsure."""

    std: FloatArray
    before: FloatArray

    @property
    def value(self) -> float:
        """Return by how many times the standard deviation falls, as a logarithm, all joints."""
        return float(np.log(self.before / np.maximum(self.std, 1e-12)).mean())


@dataclass(frozen=True, eq=False)
class GravityDoubt:
    """
    The doubt of a model over poses; `joints` are unsure, those first that cost most.

    `root` (K, R) is that of the covariance, `spread` (N, R, R) the mean square over the poses.
    """

    model: GravityModel
    joints: tuple[int, ...]
    root: FloatArray
    spread: FloatArray

    @property
    def cost(self) -> float:
        """Return the standard deviation of the worst joint over the poses, N·m."""
        return float(self._std(np.eye(self.root.shape[1])).max())

    def nothing(self) -> FloatArray:
        """Return the information of no motion."""
        n = self.model.n_joints
        return np.zeros((self.root.shape[1] + n * (n + 3),) * 2)

    def information(self, q: FloatArray, own: FloatArray, weights: FloatArray) -> FloatArray:
        """
        Return the information of poses q (M, N) on parameters and nuisance terms.

        :param own: nuisance columns (M, N, N + 3) of each joint. :param weights: (N,) in
            1/(N·m)² a row.
        """
        total, r = self.nothing(), self.root.shape[1]
        columns = _columns(self.model, q) @ self.root
        for n, weight in enumerate(weights):
            mine = slice(r + n * own.shape[2], r + (n + 1) * own.shape[2])
            a, b = columns[:, n], own[:, n]
            cross = weight * (a.T @ b)
            total[:r, :r] += weight * (a.T @ a)
            total[:r, mine] += cross
            total[mine, :r] += cross.T
            total[mine, mine] += weight * (b.T @ b)
        return total

    def answer(self, information: FloatArray) -> GravityAnswer:
        """Return the standard deviations that information leaves of the unsure joints."""
        r = self.root.shape[1]
        nuisance = information[r:, r:] + _NUISANCE * np.eye(len(information) - r)
        cross = information[:r, r:]
        told = information[:r, :r] - cross @ np.linalg.solve(nuisance, cross.T)
        before = self._std(np.eye(r))
        left = np.asarray(np.linalg.inv(np.eye(r) + 0.5 * (told + told.T)))
        return GravityAnswer(self._std(left), before)

    def _std(self, left: FloatArray) -> FloatArray:
        variance = np.einsum('ij,nji->n', left, self.spread[list(self.joints)])
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def gravity_doubt(model: GravityModel, q: FloatArray, tau: FloatArray, noise: FloatArray,
                  whatever: bool = False) -> GravityDoubt | None:
    """
    Return where a model is unsure over poses q (M, N); None if nowhere, or if it does not say.

    :param tau: measured torque (M, N). :param noise: its white noise (N,) in N·m.
    :param whatever: count all joints as unsure.
    """
    if model.uncertainty is None:
        return None
    q = q[evenly_picked(len(q), _POSES)]
    values, vectors = np.linalg.eigh(model.uncertainty.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    columns = _columns(model, q) @ root
    share = (columns ** 2).sum(axis=(0, 1))
    kept = share > _LEAST * max(float(share.sum()), 1e-300)
    columns = columns[:, :, kept]
    spread = np.einsum('pni,pnj->nij', columns, columns) / len(q)
    std = np.sqrt(np.einsum('nii->n', spread))
    limit = np.maximum(UNSURE * np.ptp(tau, axis=0), _ABOVE_NOISE * noise)
    joints = [int(n) for n in np.argsort(-std) if whatever or std[n] > limit[n]]
    return GravityDoubt(model, tuple(joints), root[:, kept], spread) if joints else None


def _columns(model: GravityModel, q: FloatArray) -> FloatArray:
    """Return how torque changes with what the covariance is of, (M, N, K)."""
    if model.chain is not None:
        return np.asarray(model.chain.jacobian(q).transpose(2, 1, 0))
    assert isinstance(model.uncertainty, EnergyUncertainty)
    columns = np.asarray(EnergyDesign(q, np.ones_like(q)).columns(model.uncertainty.indices))
    return columns.reshape(model.n_joints, len(q), -1).transpose(1, 0, 2)
