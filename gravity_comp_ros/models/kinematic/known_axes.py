"""
Known axes of a chain: its fit to the axes of a URDF, and right angles that stay in an update.

With known axes only the moments are free. A base tilt is added if it is more probable than a level
base. A moment that is 0 within its uncertainty is dropped by Akaike's criterion: the possible harm
is as small as the possible benefit, and the model prints shorter.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Solution, solve
import numpy as np

# Standard deviation of a machined and zeroed right angle, in rad.
TOLERANCE = 1e-3
# An angle is an adopted right angle if its std is below this multiple of the tolerance.
_ADOPTED = 1.5
# Log evidence that a base tilt must gain; its prior range is a radian.
_MIN_LOG_EVIDENCE = 3.0
# Price of a moment in chi^2.
_AKAIKE = 2.0


def solve_known(problem: ChainProblem, rotations: FloatArray, *,
                mounted: bool = False) -> Solution:
    """
    Return the best moments for axes (N, 3, 3), the first of them rotated if the base is tilted.

    Rotation of the base about the vertical has no effect, so a tilt has two angles.

    :param mounted: whether the tilt of the base is known too.
    """
    level = solve(problem, rotations, _free(problem, base=False))
    if mounted:
        return _drop_moments(problem, level)
    tilted = solve(problem, rotations, _free(problem, base=True))
    spread = np.sqrt(np.diag(np.linalg.inv(tilted.precision))[:2])
    price = np.log(1.0 / np.minimum(np.hypot(spread, TOLERANCE), 1.0)).sum()
    gain = 0.5 * (level.cost - tilted.cost)
    return _drop_moments(problem, tilted if gain - price > _MIN_LOG_EVIDENCE else level)


def step_covariance(solution: Solution) -> FloatArray:
    """
    Return the covariance (4N, 4N) of a step from the chain.

    Known angles have the standard deviation of a machined right angle; dropped moments keep the
    uncertainty that allowed dropping them.
    """
    known = np.flatnonzero(~solution.free[:2 * solution.chain.n_joints])
    precision = solution.precision.copy()
    precision[known, known] += TOLERANCE ** -2
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


def _free(problem: ChainProblem, base: bool) -> BoolArray:
    """Return the mask (4N,) of the moments and, optionally, the base tilt."""
    free = np.ones(4 * problem.n_joints, dtype=bool)
    free[:2 * problem.n_joints] = False
    free[:2] = base
    return free


def _drop_moments(problem: ChainProblem, solution: Solution) -> Solution:
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
