"""
A chain whose axes are known, such as from a URDF: only its moments are fitted.

The base is asked whether it stands as the description says: a tilt of it is taken where the data
make that likelier than none (as for right angles, `chain_angles`).
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, solve
from gravity_comp_ros.models.kinematic.right_angles import drop_moments, Tidy, TOLERANCE
import numpy as np

# A tilt must be this much likelier than none (natural logarithm), and is sought up to a radian.
_LIKELIER = 3.0


def solve_known(problem: ChainProblem, rotations: FloatArray) -> Tidy:
    """
    Return the best moments for axes (N, 3, 3), the first of them turned if the base is tilted.

    A turn of the base about the vertical is without effect, so that a tilt has two angles.
    """
    level = solve(problem, rotations, _free(problem, base=False))
    tilted = solve(problem, rotations, _free(problem, base=True))
    spread = np.sqrt(np.diag(np.linalg.inv(tilted.precision))[:2])
    price = np.log(1.0 / np.minimum(np.hypot(spread, TOLERANCE), 1.0)).sum()
    gained = 0.5 * (level.cost - tilted.cost)
    best = tilted if gained - price > _LIKELIER else level
    tidied = drop_moments(problem, best)
    n = problem.n_joints
    return Tidy(tidied, n * (2,), np.full(2 * n, TOLERANCE))


def _free(problem: ChainProblem, base: bool) -> BoolArray:
    free = np.ones(4 * problem.n_joints, dtype=bool)
    free[:2 * problem.n_joints] = False
    free[:2] = base
    return free
