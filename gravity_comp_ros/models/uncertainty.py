"""
Standard deviation of a model's torque at any pose.

The covariance of the fitted parameters, from noise and prior, is propagated through the derivative
of the torque by the parameters. This is exact for an energy, which is linear in its weights, and
linearised for a chain. Measurement noise is not included (`GravityModel.noise`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np

# Number of poses per batch, which bounds the memory.
_AT_ONCE = 1000


class Uncertainty(Protocol):
    """Uncertainty of a model's torque."""

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance of the fitted parameters."""

    def std(self, q: FloatArray) -> FloatArray:
        """Return the standard deviation (M, N) in N·m of the torque of poses q (M, N)."""


@dataclass(frozen=True, eq=False)
class EnergyUncertainty:
    """
    The covariance (K, K) of the weights of an energy's features `indices` (K,).

    :raises DataError: if shapes disagree or a number is not finite.
    """

    indices: IntArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, 'indices', np.asarray(self.indices, dtype=np.int64))
        object.__setattr__(self, 'covariance', _checked(self.covariance, len(self.indices)))

    @cached_property
    def _root(self) -> FloatArray:
        return _factor(self.covariance)

    def std(self, q: FloatArray) -> FloatArray:
        parts = [np.zeros((0, q.shape[1]))]
        for batch in _batches(q):
            columns = EnergyDesign(batch, np.ones(batch.shape)).columns(self.indices)
            parts.append(np.sqrt(((columns @ self._root) ** 2).sum(axis=1)).reshape(
                q.shape[1], -1).T)
        return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class ChainUncertainty:
    """
    The covariance (4N, 4N) of a step from a chain (`Chain.moved`).

    :raises DataError: if shapes disagree or a number is not finite.
    """

    chain: Chain
    covariance: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, 'covariance',
                           _checked(self.covariance, 4 * self.chain.n_joints))

    @cached_property
    def _root(self) -> FloatArray:
        return _factor(self.covariance)

    def std(self, q: FloatArray) -> FloatArray:
        parts = [np.zeros((0, q.shape[1]))]
        for batch in _batches(q):
            spread = np.tensordot(self._root.T, self.chain.jacobian(batch), axes=(1, 0))
            parts.append(np.sqrt((spread ** 2).sum(axis=0)).T)
        return np.concatenate(parts)


def _batches(q: FloatArray) -> list[FloatArray]:
    return [q[start:start + _AT_ONCE] for start in range(0, len(q), _AT_ONCE)]


def _factor(covariance: FloatArray) -> FloatArray:
    """Return L with L L.T = covariance; it may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _checked(covariance: FloatArray, size: int) -> FloatArray:
    array = np.asarray(covariance, dtype=np.float64)
    if array.shape != (size, size):
        raise DataError(f'uncertainty: a covariance of {array.shape} for {size} parameters')
    if not np.isfinite(array).all():
        raise DataError('uncertainty: a number is not finite')
    return array
