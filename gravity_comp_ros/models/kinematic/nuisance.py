"""
Nuisance columns of a chain's search: generic friction, offset and inertia of each joint.

With coefficients c ~ N(0, S^2) of columns Z (rows in units of the noise) the torque of a joint has
the covariance I + Z S^2 Z.T. With Z S = U s V.T the products of whitened rows a and b are

    a . b - (B.T a) . (B.T b),    B = U s (1 + s^2)^(-1/2),

so that the columns themselves are never whitened.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.least_squares import svd
import numpy as np


@dataclass(frozen=True, eq=False)
class Nuisance:
    """
    C nuisance columns of each joint, which act on that joint only.

    `columns` (N, C, M) are torques per unit of coefficient; `spread` (C,) are the prior standard
    deviations of the coefficients, per N·m of noise: a noise that is overestimated, by the first
    guess or an unmodelled effect, must not suppress friction.
    """

    columns: FloatArray
    spread: FloatArray

    @classmethod
    def none(cls, n_joints: int, n_samples: int) -> Nuisance:
        """Return no columns."""
        return cls(np.zeros((n_joints, 0, n_samples)), np.zeros(0))

    def select(self, keep: IntArray) -> Nuisance:
        """Return the columns of some of the samples."""
        return replace(self, columns=self.columns[:, :, keep])

    def of_joints(self, joints: list[int]) -> Nuisance:
        """Return the columns of joints in another order."""
        return replace(self, columns=self.columns[joints])


class WeightedNuisance:
    """
    Nuisance columns with rows in units of the noise.

    :param weights: (N, M) 1 / sigma.
    """

    def __init__(self, nuisance: Nuisance, weights: FloatArray) -> None:
        self._columns = nuisance.columns
        self._inside: list[FloatArray] = []        # B (M, C) of each joint
        self._coefficients: list[FloatArray] = []  # (C, M), times a target in units of the noise
        for plain, weight in zip(nuisance.columns, weights):
            rows = plain * weight
            lengths = np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
            spread = nuisance.spread * np.linalg.norm(plain, axis=1) / lengths
            u, s, vt = svd((spread[:, None] * rows).T)
            self._inside.append(u * (s / np.sqrt(1.0 + s ** 2)))
            self._coefficients.append(spread[:, None] * (vt.T * (s / (1.0 + s ** 2))) @ u.T)

    def inside(self, rows: FloatArray) -> FloatArray:
        """Return B.T a of rows a (L, N, M), joint by joint: (L, N C)."""
        return np.concatenate([rows[:, joint] @ inside
                               for joint, inside in enumerate(self._inside)], axis=1)

    def whitened(self, row: FloatArray) -> FloatArray:
        """Return r - B B.T r of a row r (N, M)."""
        return np.stack([own - inside @ (own @ inside)
                         for own, inside in zip(row, self._inside)])

    def torque(self, target: FloatArray) -> FloatArray:
        """Return the most probable torque (N, M) in N·m, for a target (N, M) in noise units."""
        return np.stack([coefficients @ own @ columns for coefficients, own, columns
                         in zip(self._coefficients, target, self._columns)])
