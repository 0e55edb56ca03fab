"""
L1 solvers on the same matrix, run to the same duality gap.

Each solver has its own definition of tolerance; `tolerances` are tried from loose to tight, and
only the first run that reaches the gap counts. The other solvers get the dense matrix, with
columns of unit length; ours gets its Kronecker factors and the column lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import time
from typing import Any
import warnings

from bench.solver.problems import Problem
from gravity_comp_ros.models.sparse.lasso import LassoProblem
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
from gravity_comp_ros.models.sparse.sparse_problem import follow_path
import numpy as np
from scipy import linalg

# In s, for the solvers that accept a time limit.
TIME_LIMIT = 50.0

# Coefficients x of columns of unit length, and iterations.
Answer = tuple[np.ndarray, int]


@dataclass(frozen=True)
class Solver:
    """A solver with its call `solve(problem, a, tolerance)`; a `slow` one runs once."""

    name: str
    solve: Callable[[Problem, np.ndarray, float], Answer]
    tolerances: tuple[float, ...]
    slow: bool = False


def ours(problem: Problem, design: TorqueDesign, tolerance: float) -> Answer:
    lasso = LassoProblem(design, problem.b, np.ones(design.n_columns, dtype=bool))
    solution = follow_path(lasso, problem.lam)
    if not solution.certificate.gap <= 1e-6:
        raise RuntimeError(f'gap {solution.certificate.gap}')
    x = np.zeros(design.n_columns)
    x[solution.indices] = solution.x * np.sqrt(design.squared_norms()[solution.indices])
    return x, solution.iterations


def factors(problem: Problem) -> TorqueDesign:
    """Return the implicit matrix of our solver: its Kronecker factors and column lengths."""
    design = TorqueDesign(problem.q, problem.weights[:, None])
    design.squared_norms()
    return design


def _lasso(lasso: Any, problem: Problem, a: np.ndarray, tolerance: float, **limits: int) -> Answer:
    """Solve with a Lasso class of scikit-learn's interface."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        fit = lasso(problem.lam / len(problem.b), fit_intercept=False, tol=tolerance,
                    **limits).fit(a, problem.b)
    return fit.coef_, int(fit.n_iter_)


def scikit_learn(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    from sklearn.linear_model import Lasso
    return _lasso(Lasso, problem, a, tolerance, max_iter=10 ** 6)


def celer(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    from celer import Lasso
    return _lasso(Lasso, problem, a, tolerance, max_iter=1000, max_epochs=10 ** 6)


def skglm(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    from skglm import Lasso
    return _lasso(Lasso, problem, a, tolerance, max_iter=1000, max_epochs=10 ** 6)


def _cvxpy(name: str, problem: Problem, a: np.ndarray, **options) -> Answer:
    import cvxpy
    x, r = cvxpy.Variable(a.shape[1]), cvxpy.Variable(len(problem.b))
    program = cvxpy.Problem(
        cvxpy.Minimize(0.5 * cvxpy.sum_squares(r) + problem.lam * cvxpy.norm1(x)),
        [r == problem.b - a @ x])
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        try:
            program.solve(solver=name, **options)
        except cvxpy.SolverError:
            pass  # time limit
    if x.value is None:
        return np.zeros(a.shape[1]), 0
    return np.asarray(x.value), int(program.solver_stats.num_iters or 0)


def osqp(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    return _cvxpy('OSQP', problem, a, eps_abs=tolerance, eps_rel=tolerance, max_iter=10 ** 6,
                  time_limit=TIME_LIMIT)


def clarabel(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    return _cvxpy('CLARABEL', problem, a, tol_gap_rel=tolerance, tol_gap_abs=tolerance,
                  tol_feas=tolerance, time_limit=TIME_LIMIT)


def dense_admm(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    """ADMM of Boyd et al. (2011), 6.4: rho 1, factor of I + A A.T, stopping by residuals."""
    m, k = a.shape
    factor = linalg.cho_factor(np.eye(m) + a @ a.T)
    until = time.monotonic() + TIME_LIMIT
    c, z, u = a.T @ problem.b, np.zeros(k), np.zeros(k)
    for iteration in range(1, 200001):
        v = c + z - u
        x = v - a.T @ linalg.cho_solve(factor, a @ v)
        old, sum_xu = z, x + u
        z = np.sign(sum_xu) * np.maximum(np.abs(sum_xu) - problem.lam, 0.0)
        u = sum_xu - z
        if (np.linalg.norm(x - z) < tolerance * max(np.linalg.norm(z), 1.0)
                and np.linalg.norm(z - old) < tolerance * max(np.linalg.norm(u), 1.0)):
            break
        if time.monotonic() > until:
            break
    return z, iteration


OURS = Solver('gravity_comp_ros', ours, (1e-7,))
OTHERS = (
    Solver('scikit-learn', scikit_learn, (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)),
    Solver('celer', celer, (1e-4, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)),
    Solver('skglm', skglm, (1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)),
    Solver('cvxpy with OSQP', osqp, (1e-6, 1e-8), slow=True),
    Solver('cvxpy with Clarabel', clarabel, (1e-8, 1e-10), slow=True),
    Solver('dense ADMM', dense_admm, (1e-5, 1e-7), slow=True))
