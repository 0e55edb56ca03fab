"""Uncertainty of a chain's torque over the whole joint range, and whether it is large."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.uncertainty import ChainUncertainty
import numpy as np

# A fit is certain if its standard deviation over all poses is below this share of the noise.
_CERTAIN = 0.67
# It is uncertain if known axes would reduce the standard deviation by this factor, or if it
# exceeds this multiple of the noise.
_REDUCTION, _LARGE = 2.0, 2.0
# Number of poses that represent the whole joint range.
_POSES = 200


def all_poses(n_joints: int) -> FloatArray:
    """Return poses (P, N) in rad over the whole joint range, the same at every call."""
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, n_joints))


def std_over_poses(chain: Chain, covariance: FloatArray) -> FloatArray:
    """Return each joint's standard deviation (N,) in N·m, root mean square over all poses."""
    std = ChainUncertainty(chain, covariance).std(all_poses(chain.n_joints))
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
