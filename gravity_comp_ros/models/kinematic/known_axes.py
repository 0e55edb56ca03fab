"""
Fit of a chain with known axes, such as from a URDF: only its moments are free.

A base tilt is added if it is more probable than a level base.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, solve
from gravity_comp_ros.models.kinematic.right_angles import (
    drop_moments, RightAngleSolution, TOLERANCE)
import numpy as np

# Log evidence that a base tilt must gain; its prior range is a radian.
_MIN_LOG_EVIDENCE = 3.0


def solve_known(problem: ChainProblem, rotations: FloatArray) -> RightAngleSolution:
    """
    Return the best moments for axes (N, 3, 3), the first of them rotated if the base is tilted.

    Rotation of the base about the vertical has no effect, so a tilt has two angles.
    """
    level = solve(problem, rotations, _free(problem, base=False))
    tilted = solve(problem, rotations, _free(problem, base=True))
    spread = np.sqrt(np.diag(np.linalg.inv(tilted.precision))[:2])
    price = np.log(1.0 / np.minimum(np.hypot(spread, TOLERANCE), 1.0)).sum()
    gain = 0.5 * (level.cost - tilted.cost)
    best = tilted if gain - price > _MIN_LOG_EVIDENCE else level
    n = problem.n_joints
    return RightAngleSolution(drop_moments(problem, best), np.full(2 * n, TOLERANCE))


def _free(problem: ChainProblem, base: bool) -> BoolArray:
    """Return the mask (4N,) of the moments and, optionally, the base tilt."""
    free = np.ones(4 * problem.n_joints, dtype=bool)
    free[:2 * problem.n_joints] = False
    free[:2] = base
    return free
