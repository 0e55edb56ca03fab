"""
Time of this package's L1 solver and of other L1 solvers.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.solver.run

Needs requirements/bench.txt. Every solver is run with tighter and tighter tolerance until it
reaches a relative duality gap of 1e-6, which is computed from its solution, or takes 15 s; only
the last run counts. Times are medians of five repetitions, which are interleaved, so that other
load of the machine affects all solvers equally.
"""

from __future__ import annotations

from statistics import median
import time
from typing import NamedTuple

from bench.shared.runner import row_of, table_of
from bench.solver.solvers import (
    eq17, factors, long_arm, OTHERS, OURS, Problem, random_poses, relative_gap, Solver)
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
from gravity_comp_ros.models.sparse.sparse_fit import fit_sparse, SparseProblem
import numpy as np

# Required relative duality gap.
GAP = 1e-6
# Longest run in s, after which no tighter tolerance is tried; repetitions of shorter ones.
MAX_SECONDS, REPETITIONS = 15.0, 5


class Run(NamedTuple):
    """Time of a run in s, its iterations, and its relative duality gap."""

    seconds: float
    iterations: int
    gap: float


def timed(solver: Solver, problem: Problem, a: np.ndarray, tolerance: float) -> Run:
    """Return a run on a problem with the dense matrix a."""
    matrix = factors(problem) if solver is OURS else a
    started = time.perf_counter()
    x, iterations = solver.solve(problem, matrix, tolerance)
    return Run(time.perf_counter() - started, iterations, relative_gap(a, problem, x))


def compare(problem: Problem) -> str:
    """Return the table of all solvers on a problem."""
    a = problem.matrix()
    runs: dict[str, list[Run]] = {}
    used: list[tuple[Solver, float]] = []
    for solver in (OURS, *OTHERS):
        timed(solver, problem, a, solver.tolerances[0])  # compiles functions on first use
        for tolerance in solver.tolerances:
            run = timed(solver, problem, a, tolerance)
            runs[solver.name] = [run]
            if run.gap <= GAP:
                used.append((solver, tolerance))
            if run.gap <= GAP or run.seconds > MAX_SECONDS:
                break
    for _ in range(REPETITIONS - 1):
        for solver, tolerance in used:
            runs[solver.name].append(timed(solver, problem, a, tolerance))
    times = {name: median(run.seconds for run in own) for name, own in runs.items()}
    return table_of(('solver', 'time', 'relative to ours', 'iterations', 'gap'), (
        (name, f'{1e3 * times[name]:.0f} ms', f'{times[name] / times[OURS.name]:.1f} ×',
         own[-1].iterations, f'{own[-1].gap:.0e}') for name, own in runs.items()))


def growth(n_joints: int) -> tuple[object, ...]:
    """Return the row of an arm: L1 problem and whole fit of its most loaded joint."""
    problem = long_arm(n_joints)
    tau = (problem.b / problem.weights)[:, None]
    m = len(tau)
    sparse = SparseProblem(TorqueDesign, problem.q, tau, np.zeros(m, dtype=int),
                           np.arange(m) * 5 // m, np.ones(3 ** n_joints, dtype=bool))
    times: list[tuple[float, float]] = []
    for _ in range(3):
        started = time.perf_counter()
        OURS.solve(problem, factors(problem), 0.0)
        between = time.perf_counter()
        fit_sparse(sparse)
        times.append((between - started, time.perf_counter() - between))
    return (n_joints, 3 ** n_joints,
            *(f'{1e3 * median(column):.0f} ms' for column in zip(*times)))


def main() -> None:
    """Print the tables of both data sets, and that of the growth with the number of joints."""
    for title, problem in (('Eq. (17)', eq17()), ('random poses', random_poses())):
        print(f'{title}\n\n{compare(problem)}\n', flush=True)
    print(row_of(('joints', 'features', 'L1 problem', 'whole fit')), '|---|---|---|---|', sep='\n')
    for n_joints in (4, 6, 8, 10, 12):
        print(row_of(growth(n_joints)), flush=True)


if __name__ == '__main__':
    main()
