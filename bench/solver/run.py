"""
Measure the solver against every other L1 solver that a user could pick, in one run.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.solver.run [--quick] [-o bench/solver/results.json]

Needs requirements/bench.txt. Every solver is brought to a relative duality gap of 1e-6, which is
computed here from its answer. Repetitions are interleaved, so that whatever else the machine does
falls on all alike; times are medians. `table.py` makes docs/performance.md's tables of the
results.
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
from bench.solver.rivals import dense_admm, halves, OURS, RIVALS, Solver
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
from gravity_comp_ros.models.sparse.sparse_fit import fit_sparse
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions, SparseProblem
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.noise import NoiseOptions
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np

GAP = 1e-6
PATIENCE = 15.0  # s for one run of one joint


def timed(solver: Solver, problem: Problem, a: np.ndarray, tolerance: float) -> dict:
    given = halves(problem) if solver is OURS else a
    started = time.perf_counter()
    x, iterations = solver.solve(problem, given, tolerance)
    seconds = time.perf_counter() - started
    return {'seconds': seconds, 'iterations': iterations, 'gap': relative_gap(a, problem, x),
            'support': int(np.count_nonzero(np.abs(x) > 1e-6 * np.abs(x).max()))}


def good_enough(solver: Solver, problem: Problem, a: np.ndarray) -> tuple[float | None, dict]:
    """
    Return the loosest tolerance that reaches the gap, with its run.

    Who has not got there after `PATIENCE` is let off: the tolerance is None, with the best run.
    """
    for tolerance in solver.tolerances:
        found = timed(solver, problem, a, tolerance)
        print(f'    {solver.name:<20} tolerance {tolerance:.0e}: gap {found["gap"]:.1e} '
              f'{found["seconds"]:.3f} s', file=sys.stderr, flush=True)
        if found['gap'] <= GAP:
            return tolerance, found
        if found['seconds'] > PATIENCE:
            break
    return None, found


def compare(name: str, problems: dict[str, Problem], repetitions: int, slow: bool) -> list[dict]:
    """Return a row a solver, over all joints of a data set; of the slow ones, over one joint."""
    matrices = {joint: problem.matrix() for joint, problem in problems.items()}
    solvers = [OURS, *(rival for rival in RIVALS if rival.slow == slow)]
    first = next(iter(problems))
    if slow:
        problems = {first: problems[first]}
    for solver in solvers:
        if not solver.slow:        # compiles what is compiled on first use
            timed(solver, problems[first], matrices[first], solver.tolerances[0])
    runs: dict[str, dict[str, list[dict]]] = {s.name: {j: [] for j in problems} for s in solvers}
    chosen: dict[tuple[str, str], float | None] = {}
    short: dict[str, dict] = {}    # who did not get there
    for joint, problem in problems.items():
        print(f'  {name} {joint}', file=sys.stderr, flush=True)
        for solver in solvers:
            # The slow ones take minutes: one joint, once, stands for all.
            if joint != first and (solver.slow or solver.name in short):
                continue
            tolerance, found = good_enough(solver, problem, matrices[joint])
            chosen[solver.name, joint] = tolerance
            if tolerance is None:
                short[solver.name] = {'joint': joint, **found}
            elif solver.slow:
                runs[solver.name][joint].append(found)
    for _ in range(repetitions):
        for joint, problem in problems.items():
            for solver in solvers:
                tolerance = chosen.get((solver.name, joint))
                if tolerance is not None and not solver.slow:
                    runs[solver.name][joint].append(
                        timed(solver, problem, matrices[joint], tolerance))
    mine = {joint: median(runs[OURS.name][joint], 'seconds') for joint in problems}
    rows: list[dict] = [{'build': build(problems[first])}]
    for solver in solvers:
        done = {joint: found for joint, found in runs[solver.name].items() if found}
        missed = short.get(solver.name)
        if missed or not done:
            rows.append({'solver': solver.name, 'missed': {
                **(missed or {}), 'ratio': missed['seconds'] / mine[missed['joint']]}})
            continue
        seconds = sum(median(found, 'seconds') for found in done.values())
        # Those behind cvxpy have threads of their own, which do not live on in a copy.
        memory = None if solver.slow else peak_megabytes(
            timed, solver, problems[first], matrices[first], chosen[solver.name, first])
        rows.append({
            'solver': solver.name, 'joints': list(done),
            'repetitions': min(len(found) for found in done.values()),
            'seconds': seconds, 'ratio': seconds / sum(mine[joint] for joint in done),
            'iterations': sum(int(median(found, 'iterations')) for found in done.values()),
            'gap': max(max(run['gap'] for run in found) for found in done.values()),
            'support': [found[0]['support'] for found in done.values()],
            'megabytes': memory})
    return rows


def build(problem: Problem) -> dict:
    """Return what the rivals' matrix and our halves take to build, in s and MB."""
    found = {}
    for name, make in (('matrix', problem.matrix), ('halves', lambda: halves(problem))):
        started = time.perf_counter()
        make()
        found[name] = {'seconds': time.perf_counter() - started,
                       'megabytes': peak_megabytes(make)}
    return found


def median(runs: list[dict], what: str) -> float:
    return float(np.median([run[what] for run in runs]))


def refit(repetitions: int) -> dict:
    """Return the time and memory of a complete `potential` refit of the iiwa on Eq. (17)."""
    seconds, memory = [], []
    for seed in range(repetitions):
        samples = synthesise(arms.iiwa7(), motions.eq17(), SynthesisOptions(
            static=True, seed=seed, noise=NoiseOptions(absolute=0.1)))
        if not seed:
            fit(samples)
            memory.append(peak_megabytes(fit, samples))
        before = time.perf_counter(), time.process_time()
        fit(samples, FitOptions('potential'))
        seconds.append((time.perf_counter() - before[0], time.process_time() - before[1]))
    wall, processor = np.median(np.array(seconds), axis=0)
    return {'samples': 500, 'wall_seconds': float(wall), 'processor_seconds': float(processor),
            'megabytes': memory[0], 'repetitions': repetitions}


def growth(joints: range, repetitions: int) -> list[dict]:
    """Return time and memory of one joint of ever longer arms, and of the dense solver's."""
    rows = []
    for n in joints:
        problem = long_arm(n)
        tau = (problem.b / problem.weights)[:, None]
        sparse = SparseProblem(TorqueDesign, problem.q, tau, np.zeros(len(tau), dtype=int),
                               np.ones(3 ** n, dtype=bool))
        solve, whole = [], []
        for _ in range(repetitions):
            started = time.perf_counter()
            x, _ = OURS.solve(problem, halves(problem), 0.0)
            solve.append(time.perf_counter() - started)
            started = time.perf_counter()
            found = fit_sparse(sparse, SparseOptions())
            whole.append(time.perf_counter() - started)
        row = {'joints': n, 'features': 3 ** n, 'seconds': float(np.median(solve)),
               'fit_seconds': float(np.median(whole)), 'l1_support': int(np.count_nonzero(x)),
               'support': len(found.indices), 'gap': found.lasso.certificate.gap,
               'megabytes': peak_megabytes(fit_sparse, sparse, SparseOptions())}
        if n <= 7:
            a = problem.matrix()
            solver = next(r for r in RIVALS if r.solve is dense_admm)
            dense = good_enough(solver, problem, a)
            row['dense_seconds'], row['dense_gap'] = dense[1]['seconds'], dense[1]['gap']
            row['dense_megabytes'] = a.nbytes / 1e6 + peak_megabytes(
                dense_admm, problem, a, 1e-3)
        print(f'  {row}', file=sys.stderr, flush=True)
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--quick', action='store_true', help='without cvxpy and dense ADMM')
    parser.add_argument('--repetitions', type=int, default=5)
    parser.add_argument('--only', nargs='*', default=None, help='these parts, the rest as it was')
    parser.add_argument('-o', '--output', type=Path,
                        default=Path(__file__).with_name('results.json'))
    args = parser.parse_args()
    results = {
        'machine': f'{os.cpu_count()} cores, {platform.machine()}',
        'python': platform.python_version(), 'numpy': np.__version__}
    parts = [('refit', lambda: refit(args.repetitions)),
             ('random', lambda: compare('random', random_poses(), args.repetitions, False)),
             ('growth', lambda: growth(range(4, 13), min(args.repetitions, 3))),
             ('eq17', lambda: compare('eq17', eq17(), args.repetitions, False)),
             ('eq17_slow', lambda: compare('eq17', eq17(), args.repetitions, True)),
             ('random_slow', lambda: compare('random', random_poses(), args.repetitions, True))]
    if args.only is not None and args.output.exists():
        results = json.loads(args.output.read_text())
    for name, part in parts:
        if (args.quick and name.endswith('_slow')) or (args.only and name not in args.only):
            continue
        results[name] = part()
        args.output.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
