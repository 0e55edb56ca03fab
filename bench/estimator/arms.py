"""
Accuracy of the default fit on many arms, compared with least squares with known kinematics.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.estimator.arms [--seeds 10] [--friction 0 0.01]

100 s of slow motion at 5 Hz with 0.1 N·m of noise; friction is Coulomb plus viscous, each that
share of the joint's gravity range. Errors are the worst joint's RMSE over 1000 poses of the whole
joint range. The estimator was tuned on the builds marked `tuning`. `limit` is the Cramer-Rao bound
of an arm with unknown axes: the mean square of the errors over many seeds cannot be below it,
unless the estimate uses prior knowledge.
"""

from __future__ import annotations

import argparse
import time

from bench.estimator.builds import Build, builds, Case
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
import numpy as np


def measure(build: Build, friction: float, seed: int, formulation: str) -> dict:
    """Return error, floor and processor time of one fit."""
    case = Case(build, friction, seed)
    samples = case.samples()
    start = time.process_time()
    result = fit(samples, FitOptions(formulation))
    seconds = time.process_time() - start
    error = case.error(result.model.predict, case.poses())
    return {'error': float(error.max()), 'joint': int(error.argmax()), 'seconds': seconds,
            'floor': case.floor(samples), 'limit': case.limit(samples),
            'formulation': result.model.formulation}


def line(title: str, rows: list[dict], ratios: list[float]) -> str:
    """Return the printed line of a build, over all its seeds."""
    error, floor, limit = (float(np.sqrt(np.mean([row[key] ** 2 for row in rows])))
                           for key in ('error', 'floor', 'limit'))
    return (f'{title} error worst {max(row["error"] for row in rows):6.3f} N·m, RMS of seeds '
            f'{error:6.3f}, limit {limit:6.3f}, floor {floor:6.3f}; error over floor RMS '
            f'{error / floor:5.2f} worst {max(ratios):6.2f} median {np.median(ratios):5.2f}, CPU '
            f'{max(row["seconds"] for row in rows):5.2f} s, '
            f'{"/".join(sorted({row["formulation"] for row in rows}))}')


def main() -> None:
    """Measure and print one line for each build."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=10)
    parser.add_argument('--friction', type=float, nargs='+', default=[0.0, 0.01])
    parser.add_argument('--formulation', default=FitOptions().formulation)
    parser.add_argument('--only', choices=['tuning', 'judging'])
    args = parser.parse_args()
    for friction in args.friction:
        ratios: dict[bool, list[float]] = {True: [], False: []}
        for build in builds():
            if args.only and build.tuning != (args.only == 'tuning'):
                continue
            rows = [measure(build, friction, seed, args.formulation)
                    for seed in range(args.seeds)]
            build_ratios = [row['error'] / row['floor'] for row in rows]
            ratios[build.tuning] += build_ratios
            print(line(f'friction {friction:5.3f} {"tuning " if build.tuning else "judging"} '
                       f'{build.name:17s}', rows, build_ratios), flush=True)
        for tuning, group in ratios.items():
            if group:
                print(f'friction {friction:5.3f} {"tuning" if tuning else "judging"}: ratio worst '
                      f'{max(group):.2f}, median {np.median(group):.2f}, above 3: '
                      f'{np.mean(np.array(group) > 3):.0%}')


if __name__ == '__main__':
    main()
