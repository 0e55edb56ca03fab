"""
Compare the Levenberg-Marquardt of the chain with `scipy.optimize.least_squares`.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.estimator.least_squares [--seeds 10]

Both minimise the same cost from the same start: torques of 500 poses with 0.1 N·m of noise, and
axes rotated by 0.3 rad or by 0.8 rad from the true ones. SciPy searches axes and moments together
with a finite-difference Jacobian, since its steps leave the chart in which our Jacobian is exact;
the table therefore has the number of steps as well as the time. A solver reaches the minimum from
a start if its cost is within 1 % of the lowest of all solvers.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass
from functools import partial
import time

from bench.cases.generated import generated_arm
from bench.cases.six_axis import six_axis
from gravity_comp_ros.models.kinematic.chain import Chain, tilt
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, solve, SolveOptions
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
import numpy as np
from scipy.optimize import least_squares

ARMS = {'iiwa7': iiwa7, 'six_axis': six_axis,
        **{f'drawn{k}': partial(generated_arm, k, 6) for k in range(3)}}
_NOISE, _POSES = 0.1, 500


@dataclass(frozen=True)
class Run:
    """Result of one solver from one start: cost, processor time in s, steps."""

    cost: float
    seconds: float
    steps: int


def ours(problem: ChainProblem, axes: np.ndarray) -> Run:
    """Minimise with the package's own solver."""
    begun = time.process_time()
    solution = solve(problem, axes, options=SolveOptions(tolerance=1e-9))
    return Run(solution.cost, time.process_time() - begun, solution.steps)


def scipy_solver(problem: ChainProblem, axes: np.ndarray, method: str) -> Run:
    """Minimise over axes and moments with SciPy, starting at the best moments for these axes."""
    n = problem.n_joints
    start = Chain(axes, np.zeros((n, 2)))
    columns = start.jacobian(problem.q)[2 * n:].reshape(2 * n, -1).T
    moments = np.linalg.lstsq(columns, problem.tau.T.ravel(), rcond=1e-9)[0]
    root = np.sqrt(problem.moment_precision)

    def residual(x: np.ndarray) -> np.ndarray:
        chain = Chain(axes @ tilt(x[:2 * n].reshape(n, 2)), x[2 * n:].reshape(n, 2))
        weighted = (problem.tau - chain.torque(problem.q)) * problem.weights
        return np.concatenate([weighted.ravel(), root * x[2 * n:]])

    begun = time.process_time()
    solution = least_squares(residual, np.concatenate([np.zeros(2 * n), moments]), method=method,
                             x_scale=1.0, ftol=1e-9, xtol=1e-12, gtol=1e-12, max_nfev=4000)
    return Run(2.0 * float(solution.cost), time.process_time() - begun, solution.nfev)


def starts(seed: int) -> list[tuple[str, ChainProblem, np.ndarray]]:
    """Return distance, problem and start axes, for each arm and distance."""
    rng, result = np.random.default_rng(seed), []
    for name, make in ARMS.items():
        arm = make()
        n = arm.n_joints
        true = np.array([arm.model.jointPlacements[k + 1].rotation for k in range(n)])
        q = rng.uniform(arm.lower, arm.upper, (_POSES, n))
        tau = gravity_torque(arm, q) + rng.normal(scale=_NOISE, size=q.shape)
        problem = ChainProblem(q, tau, np.full(q.shape, 1.0 / _NOISE))
        for distance in (0.3, 0.8):
            rotated = true @ tilt(rng.normal(scale=distance / np.sqrt(2.0), size=(n, 2)))
            result.append((f'{distance} rad', problem, rotated))
    return result


def main() -> None:
    """Print a line for each distance of the start and each solver."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=10)
    runs: dict[str, list[dict[str, Run]]] = defaultdict(list)
    for seed in range(parser.parse_args().seeds):
        for distance, problem, axes in starts(seed):
            runs[distance].append({'own': ours(problem, axes),
                                   'lm': scipy_solver(problem, axes, 'lm'),
                                   'trf': scipy_solver(problem, axes, 'trf')})
    print('| start | solver | reached | processor time, ms | steps tried |')
    print('|---|---|---|---|---|')
    for distance, results in runs.items():
        lowest = [min(run.cost for run in result.values()) for result in results]
        for name in ('own', 'lm', 'trf'):
            reached = sum(result[name].cost <= 1.01 * low
                          for result, low in zip(results, lowest))
            print(f'| {distance} | {name} | {reached} of {len(results)} | '
                  f'{1e3 * np.median([result[name].seconds for result in results]):.0f} | '
                  f'{np.median([result[name].steps for result in results]):.0f} |')


if __name__ == '__main__':
    main()
