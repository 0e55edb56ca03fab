"""
Compare the Levenberg-Marquardt of the chain with `scipy.optimize.least_squares`.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.estimator.least_squares [--seeds 10]

Both minimise the same cost from the same start: torques of 500 poses with 0.1 N·m of noise, and
axes that are turned by 0.3 rad or by 0.8 rad from the true ones. SciPy searches axes and moments
together with a Jacobian by differences, since its steps leave the chart in which ours is exact; so
the steps that it tries are counted beside its time. A start is reached by a solver if the cost is
within 1 % of the lowest that either found.
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
    """What one solver did from one start."""

    cost: float
    seconds: float
    steps: int


def ours(problem: ChainProblem, axes: np.ndarray) -> Run:
    """Minimise with the package's own solver."""
    begun = time.process_time()
    found = solve(problem, axes, options=SolveOptions(tolerance=1e-9))
    return Run(found.cost, time.process_time() - begun, found.steps)


def scipys(problem: ChainProblem, axes: np.ndarray, method: str) -> Run:
    """Minimise axes and moments together with SciPy, from the moments that fit the start."""
    n = problem.n_joints
    start = Chain(axes, np.zeros((n, 2)))
    columns = start.jacobian(problem.q)[2 * n:].reshape(2 * n, -1).T
    moments = np.linalg.lstsq(columns, problem.tau.T.ravel(), rcond=1e-9)[0]
    root = np.sqrt(problem.moment_precision)

    def residual(x: np.ndarray) -> np.ndarray:
        chain = Chain(axes @ tilt(x[:2 * n].reshape(n, 2)), x[2 * n:].reshape(n, 2))
        left = (problem.tau - chain.torque(problem.q)) * problem.weights
        return np.concatenate([left.ravel(), root * x[2 * n:]])

    begun = time.process_time()
    found = least_squares(residual, np.concatenate([np.zeros(2 * n), moments]), method=method,
                          x_scale=1.0, ftol=1e-9, xtol=1e-12, gtol=1e-12, max_nfev=4000)
    return Run(2.0 * float(found.cost), time.process_time() - begun, found.nfev)


def starts(seed: int) -> list[tuple[str, ChainProblem, np.ndarray]]:
    """Return a problem and a start of each arm and distance."""
    rng, found = np.random.default_rng(seed), []
    for name, make in ARMS.items():
        arm = make()
        n = arm.n_joints
        true = np.array([arm.model.jointPlacements[k + 1].rotation for k in range(n)])
        q = rng.uniform(arm.lower, arm.upper, (_POSES, n))
        tau = gravity_torque(arm, q) + rng.normal(scale=_NOISE, size=q.shape)
        problem = ChainProblem(q, tau, np.full(q.shape, 1.0 / _NOISE))
        for far in (0.3, 0.8):
            turned = true @ tilt(rng.normal(scale=far / np.sqrt(2.0), size=(n, 2)))
            found.append((f'{far} rad', problem, turned))
    return found


def main() -> None:
    """Print a line for each distance of the start and each solver."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=10)
    runs: dict[str, list[dict[str, Run]]] = defaultdict(list)
    for seed in range(parser.parse_args().seeds):
        for where, problem, axes in starts(seed):
            runs[where].append({'own': ours(problem, axes),
                                'lm': scipys(problem, axes, 'lm'),
                                'trf': scipys(problem, axes, 'trf')})
    print('| start | solver | reached | processor time, ms | steps tried |')
    print('|---|---|---|---|---|')
    for where, each in runs.items():
        best = [min(run.cost for run in one.values()) for one in each]
        for name in ('own', 'lm', 'trf'):
            reached = sum(one[name].cost <= 1.01 * low for one, low in zip(each, best))
            print(f'| {where} | {name} | {reached} of {len(each)} | '
                  f'{1e3 * np.median([one[name].seconds for one in each]):.0f} | '
                  f'{np.median([one[name].steps for one in each]):.0f} |')


if __name__ == '__main__':
    main()
