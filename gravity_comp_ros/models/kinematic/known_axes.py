"""Known axes of a chain: the moments on them, and right angles that stay in an update."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.chain_solver import MOMENT_STD
import numpy as np

# Standard deviation of a machined and zeroed right angle, in rad.
TOLERANCE = 1e-3
# An angle is an adopted right angle if its std is below this multiple of the tolerance.
_ADOPTED = 1.5


def moments_on_axes(rotations: FloatArray, q: FloatArray, tau: FloatArray, sigma: FloatArray
                    ) -> tuple[Chain, FloatArray]:
    """
    Return the chain of the most probable moments on known axes, and the covariance of a step.

    :param rotations: the axes (N, 3, 3).
    :param q: poses (M, N). :param tau: torques (M, N) in N·m, `sigma` their standard deviations.
    """
    n = len(rotations)
    prior = np.full(2 * n, (MOMENT_STD * max(float(np.abs(tau).max()), 1e-9)) ** -2.0)
    rows = (ForwardKinematics(rotations, q).moment_columns() / sigma.T).reshape(2 * n, -1)
    moments = np.linalg.solve(rows @ rows.T + np.diag(prior), rows @ (tau / sigma).T.ravel())
    chain = Chain(rotations, moments.reshape(n, 2))
    rows = (chain.jacobian(q) / sigma.T).reshape(4 * n, -1)
    precision = rows @ rows.T + np.diag(np.concatenate([np.full(2 * n, TOLERANCE ** -2.0), prior]))
    return chain, np.asarray(np.linalg.inv(precision))


def right_angles_kept(mean: FloatArray, covariance: FloatArray, before: FloatArray) -> FloatArray:
    """
    Return the mean of a step (K,), first angles (2N,), given that right angles stay right.

    :param covariance: of the step, (K, K).
    :param before: the covariance (K, K) before the new data; angles with a standard deviation near
        the tolerance are right angles.
    """
    half = len(mean) // 2
    spread = np.sqrt(np.maximum(np.diag(before)[:half], 0.0))
    adopted = np.flatnonzero((spread > 0.0) & (spread < _ADOPTED * TOLERANCE))
    shift = np.linalg.pinv(covariance[np.ix_(adopted, adopted)], hermitian=True) @ mean[adopted]
    kept = mean - covariance[:, adopted] @ shift
    kept[adopted] = 0.0
    return np.asarray(kept)
