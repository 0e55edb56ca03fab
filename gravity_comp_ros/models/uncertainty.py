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

from gravity_comp_ros.data.poses import batches, random_poses
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np

# A fit is certain if its standard deviation over all poses is below this share of the noise.
_CERTAIN = 0.67
# It is uncertain if known axes would reduce the standard deviation by this factor, or if it
# exceeds this multiple of the noise.
_REDUCTION, _LARGE = 2.0, 2.0


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
        parts = []
        for batch in (q[rows] for rows in batches(len(q))):
            columns = EnergyDesign(batch, np.ones(batch.shape)).columns(self.indices)
            parts.append(np.sqrt(((columns @ self._root) ** 2).sum(axis=1)).reshape(
                *batch.T.shape).T)
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
        parts = []
        for batch in (q[rows] for rows in batches(len(q))):
            spread = np.tensordot(self._root.T, self.chain.jacobian(batch), axes=(1, 0))
            parts.append(np.sqrt((spread ** 2).sum(axis=0)).T)
        return np.concatenate(parts)


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


def std_over_poses(chain: Chain, covariance: FloatArray) -> FloatArray:
    """Return each joint's standard deviation (N,) in N·m, root mean square over all poses."""
    std = ChainUncertainty(chain, covariance).std(random_poses(chain.n_joints))
    return np.asarray(np.sqrt((std ** 2).mean(axis=0)))


def std_with_known_axes(chain: Chain, covariance: FloatArray) -> FloatArray:
    """Return the same as `std_over_poses`, conditioned on the axes."""
    half = 2 * chain.n_joints
    known = np.zeros_like(covariance)
    axes, cross, moments = covariance[:half, :half], covariance[:half, half:], \
        covariance[half:, half:]
    # After an update the covariance may be singular.
    known[half:, half:] = moments - cross.T @ np.linalg.pinv(axes, hermitian=True) @ cross
    return std_over_poses(chain, known)


def least_certain_joint(chain: Chain, covariance: FloatArray, noise: FloatArray) -> int | None:
    """Return the joint with the largest relative torque uncertainty; None if all are certain."""
    std = std_over_poses(chain, covariance)
    worst = int(np.argmax(std / noise))
    relative = std[worst] / noise[worst]
    reduction = std[worst] / max(float(std_with_known_axes(chain, covariance)[worst]), 1e-300)
    is_certain = relative <= _CERTAIN or (relative <= _LARGE and reduction <= _REDUCTION)
    return None if is_certain else worst
