"""One L1 problem of the paper (Eqs. 8-9), solved by this package's ADMM and by cvxpy."""

from __future__ import annotations

from dataclasses import dataclass
import time

from bench.paper.scenes import FloatArray
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.sparse.identifiability import usable_for_torque
from gravity_comp_ros.models.sparse.lasso import column_lengths, has_length, LassoProblem
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
import numpy as np


@dataclass(frozen=True)
class Solved:
    """A solver's objective, number of nonzero features, and time in s."""

    name: str
    objective: float
    features: int
    seconds: float


def compare_solvers(samples: JointSamples, joint: int, sigma: float,
                    with_cvxpy: bool = True) -> list[Solved]:
    """Return the solutions for one joint's torque, at lambda = sqrt(2 ln 3^N)."""
    design = TorqueDesign(samples.q, np.full((samples.n_samples, 1), 1.0 / sigma))
    b = samples.tau[:, joint] / sigma
    usable = usable_for_torque(samples.q)
    lam = float(np.sqrt(2.0 * np.log(design.n_columns)))
    start = time.perf_counter()
    solution = LassoProblem(design, b, usable).solve(lam)
    seconds = time.perf_counter() - start
    lengths = column_lengths(design)
    kept = np.flatnonzero(usable & has_length(lengths))
    unit = design.columns(kept) / lengths[kept]
    ours = np.zeros(len(kept))
    ours[np.searchsorted(kept, solution.indices)] = solution.x * lengths[solution.indices]
    rows = [Solved('ADMM on a working set (this package)', _objective(unit, b, ours, lam),
                   len(solution.indices), seconds)]
    return [*rows, _cvxpy(unit, b, lam)] if with_cvxpy else rows


def _cvxpy(unit: FloatArray, b: FloatArray, lam: float) -> Solved:
    import cvxpy
    start = time.perf_counter()
    x = cvxpy.Variable(unit.shape[1])
    cost = 0.5 * cvxpy.sum_squares(unit @ x - b) + lam * cvxpy.norm1(x)
    problem = cvxpy.Problem(cvxpy.Minimize(cost))
    problem.solve(solver=cvxpy.CLARABEL)
    seconds = time.perf_counter() - start
    value = np.asarray(x.value)
    counted = int((np.abs(value) > 1e-4 * np.abs(value).max()).sum())
    return Solved('cvxpy (Clarabel, all columns)', _objective(unit, b, value, lam), counted,
                  seconds)


def _objective(unit: FloatArray, b: FloatArray, x: FloatArray, lam: float) -> float:
    residual = unit @ x - b
    return float(0.5 * residual @ residual + lam * np.abs(x).sum())
