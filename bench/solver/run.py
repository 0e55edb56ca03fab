"""
Time and memory of this package's L1 solver and of other L1 solvers, in one run.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.solver.run [--quick] [-o bench/solver/results.json]

Needs requirements/bench.txt. Every solver is run to a relative duality gap of 1e-6, which is
computed from its solution. Repetitions are interleaved, so that other load of the machine affects
all solvers equally; times are medians. `table.py` writes the tables of docs/performance.md from
the results.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
import platform
import sys
import time

from bench.solver.memory import peak_megabytes
from bench.solver.problems import eq17, long_arm, Problem, random_poses, relative_gap
from bench.solver.solvers import factors, OTHERS, OURS, Solver
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
from gravity_comp_ros.models.sparse.sparse_fit import fit_sparse
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions, SparseProblem
import numpy as np

# Required relative duality gap.
GAP = 1e-6
# Longest run of one joint, in s, after which no tighter tolerance is tried.
MAX_SECONDS = 15.0


def timed(solver: Solver, problem: Problem, a: np.ndarray, tolerance: float) -> dict:
    matrix = factors(problem) if solver is OURS else a
    started = time.perf_counter()
    x, iterations = solver.solve(problem, matrix, tolerance)
    seconds = time.perf_counter() - started
    return {'seconds': seconds, 'iterations': iterations, 'gap': relative_gap(a, problem, x),
            'support': int(np.count_nonzero(np.abs(x) > 1e-6 * np.abs(x).max()))}


def loosest(solver: Solver, problem: Problem, a: np.ndarray) -> tuple[float | None, dict]:
    """
    Return the loosest tolerance that reaches the gap, with its run.

    The tolerance is None, with the last run, if none reaches it or a run exceeds `MAX_SECONDS`.
    """
    for tolerance in solver.tolerances:
        run = timed(solver, problem, a, tolerance)
        print(f'    {solver.name:<20} tolerance {tolerance:.0e}: gap {run["gap"]:.1e} '
              f'{run["seconds"]:.3f} s', file=sys.stderr, flush=True)
        if run['gap'] <= GAP:
            return tolerance, run
        if run['seconds'] > MAX_SECONDS:
            break
    return None, run


def compare(name: str, problems: dict[str, Problem], repetitions: int, slow: bool) -> list[dict]:
    """Return a row for each solver, over all joints of a data set, or one joint if slow."""
    matrices = {joint: problem.matrix() for joint, problem in problems.items()}
    solvers = [OURS, *(solver for solver in OTHERS if solver.slow == slow)]
    first = next(iter(problems))
    if slow:
        problems = {first: problems[first]}
    for solver in solvers:
        if not solver.slow:  # compiles functions on first use
            timed(solver, problems[first], matrices[first], solver.tolerances[0])
    runs: dict[str, dict[str, list[dict]]] = {s.name: {j: [] for j in problems} for s in solvers}
    tolerances: dict[tuple[str, str], float | None] = {}
    missed: dict[str, dict] = {}  # the runs of solvers that did not reach the gap
    for joint, problem in problems.items():
        print(f'  {name} {joint}', file=sys.stderr, flush=True)
        for solver in solvers:
            # The slow ones take minutes, so they solve one joint once.
            if joint != first and (solver.slow or solver.name in missed):
                continue
            tolerance, run = loosest(solver, problem, matrices[joint])
            tolerances[solver.name, joint] = tolerance
            if tolerance is None:
                missed[solver.name] = {'joint': joint, **run}
            elif solver.slow:
                runs[solver.name][joint].append(run)
    for _ in range(repetitions):
        for joint, problem in problems.items():
            for solver in solvers:
                tolerance = tolerances.get((solver.name, joint))
                if tolerance is not None and not solver.slow:
                    runs[solver.name][joint].append(
                        timed(solver, problem, matrices[joint], tolerance))
    ours = {joint: median(runs[OURS.name][joint], 'seconds') for joint in problems}
    rows: list[dict] = [{'build': build(problems[first])}]
    for solver in solvers:
        if solver.name in missed:
            run = missed[solver.name]
            rows.append({'solver': solver.name,
                         'missed': {**run, 'ratio': run['seconds'] / ours[run['joint']]}})
            continue
        # The solvers of cvxpy have their own threads, which do not survive a fork.
        memory = None if solver.slow else peak_megabytes(
            timed, solver, problems[first], matrices[first], tolerances[solver.name, first])
        rows.append(row(solver, runs[solver.name], ours, memory))
    return rows


def row(solver: Solver, runs: dict[str, list[dict]], ours: dict[str, float],
        memory: float | None) -> dict:
    """Return the row of a solver from its runs of each joint and our times."""
    runs = {joint: repeated for joint, repeated in runs.items() if repeated}
    seconds = sum(median(repeated, 'seconds') for repeated in runs.values())
    return {'solver': solver.name, 'joints': list(runs),
            'repetitions': min(len(repeated) for repeated in runs.values()),
            'seconds': seconds, 'ratio': seconds / sum(ours[joint] for joint in runs),
            'iterations': sum(int(median(repeated, 'iterations')) for repeated in runs.values()),
            'gap': max(max(run['gap'] for run in repeated) for repeated in runs.values()),
            'support': [repeated[0]['support'] for repeated in runs.values()],
            'megabytes': memory}


def build(problem: Problem) -> dict:
    """Return time in s and memory in MB for building the dense matrix and our factors."""
    costs = {}
    for name, make in (('matrix', problem.matrix), ('halves', lambda: factors(problem))):
        started = time.perf_counter()
        make()
        costs[name] = {'seconds': time.perf_counter() - started,
                       'megabytes': peak_megabytes(make)}
    return costs


def median(runs: list[dict], key: str) -> float:
    return float(np.median([run[key] for run in runs]))


def growth(joints: range, repetitions: int) -> list[dict]:
    """Return time and memory of one joint for each number of joints."""
    rows = []
    for n in joints:
        problem = long_arm(n)
        tau = (problem.b / problem.weights)[:, None]
        sparse = SparseProblem(TorqueDesign, problem.q, tau, np.zeros(len(tau), dtype=int),
                               np.ones(3 ** n, dtype=bool))
        l1_seconds, fit_seconds = [], []
        for _ in range(repetitions):
            started = time.perf_counter()
            x, _ = OURS.solve(problem, factors(problem), 0.0)
            l1_seconds.append(time.perf_counter() - started)
            started = time.perf_counter()
            result = fit_sparse(sparse, SparseOptions())
            fit_seconds.append(time.perf_counter() - started)
        costs = {'joints': n, 'features': 3 ** n, 'seconds': float(np.median(l1_seconds)),
                 'fit_seconds': float(np.median(fit_seconds)),
                 'l1_support': int(np.count_nonzero(x)), 'support': len(result.indices),
                 'gap': result.lasso.certificate.gap,
                 'megabytes': peak_megabytes(fit_sparse, sparse, SparseOptions())}
        print(f'  {costs}', file=sys.stderr, flush=True)
        rows.append(costs)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--quick', action='store_true', help='without cvxpy and dense ADMM')
    parser.add_argument('--repetitions', type=int, default=5)
    parser.add_argument('--only', nargs='*', default=None,
                        help='run these parts and keep the stored results of the others')
    parser.add_argument('-o', '--output', type=Path,
                        default=Path(__file__).with_name('results.json'))
    args = parser.parse_args()
    results = {
        'machine': f'{os.cpu_count()} cores, {platform.machine()}',
        'python': platform.python_version(), 'numpy': np.__version__}
    parts = [('random', lambda: compare('random', random_poses(), args.repetitions, False)),
             ('growth', lambda: growth(range(4, 13), min(args.repetitions, 3))),
             ('eq17', lambda: compare('eq17', eq17(), args.repetitions, False)),
             ('eq17_slow', lambda: compare('eq17', eq17(), args.repetitions, True))]
    if args.only is not None and args.output.exists():
        results = json.loads(args.output.read_text())
    for name, part in parts:
        if (args.quick and name.endswith('_slow')) or (args.only and name not in args.only):
            continue
        results[name] = part()
        args.output.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
