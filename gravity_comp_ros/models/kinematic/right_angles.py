"""
Right angles between joint axes in an update after a payload change.

An angle of a chain whose standard deviation is near the tolerance of a machined right angle stays
as it is. A moment that is 0 within its uncertainty is dropped by Akaike's criterion: the possible
harm is as small as the possible benefit, and the model prints shorter.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Solution, solve
import numpy as np

# Standard deviation of a machined and zeroed right angle, in rad.
TOLERANCE = 1e-3
# An angle is an adopted right angle if its std is below this multiple of the tolerance.
_ADOPTED = 1.5
# Price of a moment in chi^2.
_AKAIKE = 2.0


@dataclass(frozen=True, eq=False)
class RightAngleSolution:
    """A solution with right angles; `spread` (2N,) in rad is the standard deviation of each."""

    solution: Solution
    spread: FloatArray

    def covariance(self) -> FloatArray:
        """
        Return the covariance (4N, 4N) of a step from the chain.

        Adopted angles have the standard deviation `spread`; dropped moments keep the uncertainty
        that allowed dropping them.
        """
        n = self.solution.chain.n_joints
        precision = self.solution.precision.copy()
        adopted = np.flatnonzero(~self.solution.free[:2 * n])
        precision[adopted, adopted] += self.spread[adopted] ** -2
        return np.asarray(np.linalg.inv(precision))


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


def drop_moments(problem: ChainProblem, solution: Solution) -> Solution:
    """Return the solution without insignificant moments, the least significant dropped first."""
    n = problem.n_joints
    free = solution.free.copy()
    covariance = np.linalg.inv(solution.precision)[2 * n:, 2 * n:]
    moments = solution.chain.moments.ravel().copy()
    count = 0
    while True:
        remaining = np.flatnonzero(free[2 * n:])
        if not remaining.size:
            break
        loss = moments[remaining] ** 2 / np.maximum(covariance[remaining, remaining], 1e-300)
        k = remaining[int(np.argmin(loss))]
        if loss.min() > _AKAIKE:
            break
        gain = covariance[:, k] / covariance[k, k]
        moments -= gain * moments[k]
        covariance = covariance - np.outer(gain, covariance[k])
        free[2 * n + k] = False
        count += 1
    tried = solve(problem, solution.chain.axes, free)
    return tried if tried.cost - solution.cost < _AKAIKE * count else solution
