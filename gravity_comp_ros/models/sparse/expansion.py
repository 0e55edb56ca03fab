"""A sparse sum over the dictionary (Yu 2022, Eqs. 5-7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.sparse import dictionary
import numpy as np


@dataclass(frozen=True, eq=False)
class Expansion:
    """A sparse sum over the dictionary: ascending feature `indices` (K,), `weights` (K,)."""

    indices: IntArray
    weights: FloatArray

    def __post_init__(self) -> None:
        indices = np.asarray(self.indices, dtype=np.int64)
        weights = np.asarray(self.weights, dtype=np.float64)
        if indices.ndim != 1 or indices.shape != weights.shape:
            raise DataError(f'expansion: {indices.shape} features with {weights.shape} weights')
        if np.any(np.diff(indices) <= 0) or np.any(indices < 0):
            raise DataError('expansion: features must be ascending and unique')
        if not np.isfinite(weights).all():
            raise DataError('expansion: a weight is not finite')
        object.__setattr__(self, 'indices', indices)
        object.__setattr__(self, 'weights', weights)

    def evaluate(self, q: FloatArray) -> FloatArray:
        """Return the sum (M,) at poses q (M, N) in rad."""
        return np.asarray(dictionary.columns(q, self.indices) @ self.weights)

    def gradient(self, n_joints: int, joint: int) -> Expansion:
        """Return d/dq_joint of this sum, which is in the dictionary as well."""
        features, signs = dictionary.derivative(self.indices, n_joints, joint)
        present = signs != 0.0
        order = np.argsort(features[present])
        return Expansion(features[present][order],
                         (self.weights[present] * signs[present])[order])


def torque_of(torques: Sequence[Expansion], q: FloatArray) -> FloatArray:
    """Return the torques (M, N) in N·m of one expansion per joint, at poses q (M, N) in rad."""
    return np.stack([torque.evaluate(q) for torque in torques], axis=1)
