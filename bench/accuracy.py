"""
Accuracy of the gravity models on the paper's simulated arm and motions, over noise seeds.

    OPENBLAS_NUM_THREADS=1 python3 -m bench.accuracy [--seeds 10]

Random poses are those of Yu 2022, Table 3: 1000 poses, 1 % relative noise, tested on Eq. (15) by
nRMSE (Eq. 16) against the exact torque. The small motion is 100 s of Eq. (17) with 0.1 N·m noise,
tested on the 100 s after it and on 1000 poses over all joint limits. Torque is gravity alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass
import time

from gravity_comp_ros.commands import terminal
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit, FitResult
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np

ARM = arms.iiwa7()
TEST = motions.eq15()
LATER = motions.eq17(start=100.0)
ANYWHERE = motions.random_poses(ARM.lower, ARM.upper, 1000, seed=1234)
# Joints of the paper's table: J2, J3 and J4.
SHOWN = slice(1, 4)
# Minimum weight, in N·m, of a feature that a fit must select.
LARGE = 0.1
PAPER = {'nrmse': (0.43, 0.48, 0.57), 'features': (246, 76, 171)}


def random_poses(seed: int) -> JointSamples:
    """Return the training samples of Yu 2022, Table 3."""
    motion = motions.random_poses(ARM.lower, ARM.upper, 1000, seed)
    return synthesise(ARM, motion, SynthesisOptions(static=True, seed=seed,
                                                    noise=NoiseOptions(relative=0.01)))


def small_motion(seed: int, static: bool = True) -> JointSamples:
    """Return 100 s of Eq. (17) at 5 Hz with 0.1 N·m noise."""
    return synthesise(ARM, motions.eq17(), SynthesisOptions(
        static=static, seed=seed, noise=NoiseOptions(absolute=0.1)))


def rmse(result: FitResult, motion: motions.Motion, static: bool = True) -> np.ndarray:
    """Return the RMSE (N,) in N·m against the exact torque of a motion."""
    exact = synthesise(ARM, motion, SynthesisOptions(static=static)).tau
    return np.sqrt(((result.model.predict(motion.q) - exact) ** 2).mean(axis=0))


def exact_weights() -> np.ndarray:
    """Return the weights (3^7, 7) of the arm's gravity, from three angles of each joint."""
    angles = np.array([0.0, 2.0, 4.0])
    grid = np.stack(np.meshgrid(*[angles] * 7, indexing='ij'), axis=-1).reshape(-1, 7)
    weights = arms.gravity_torque(ARM, grid).reshape(*[3] * 7, 7)
    inverse = np.linalg.inv(np.column_stack([np.ones(3), np.sin(angles), np.cos(angles)]))
    for axis in range(7):
        weights = np.moveaxis(np.tensordot(inverse, weights, axes=(1, axis)), 0, axis)
    return weights.reshape(3 ** 7, 7)


@dataclass(frozen=True)
class Figures:
    """The fits of one formulation over all seeds, their errors (seeds, N) and seconds."""

    fits: list[FitResult]
    errors: dict[str, np.ndarray]
    seconds: float

    def worst(self, which: str) -> np.ndarray:
        """Return each joint's largest error (N,)."""
        return self.errors[which].max(axis=0)


def measure(train: Callable[[int], JointSamples], formulation: str, seeds: Iterable[int],
            metrics: dict[str, Callable[[FitResult], np.ndarray]]) -> Figures:
    """Fit the samples of every seed; return the fits with all error metrics."""
    started = time.perf_counter()
    fits = [fit(train(seed), FitOptions(formulation)) for seed in seeds]
    seconds = (time.perf_counter() - started) / len(fits)
    return Figures(fits, {name: np.array([error(result) for result in fits])
                          for name, error in metrics.items()}, seconds)


def table3(formulation: str, seeds: Iterable[int]) -> Figures:
    """Return the errors on Eq. (15) after random poses, as nRMSE (Yu 2022, Eq. 16)."""
    spread = np.maximum(np.ptp(arms.gravity_torque(ARM, TEST.q), axis=0), 1e-9)
    return measure(random_poses, formulation, seeds,
                   {'nrmse': lambda result: rmse(result, TEST) / spread})


def eq17(formulation: str, seeds: Iterable[int]) -> Figures:
    """Return the errors after the small slow motion, in N·m."""
    return measure(small_motion, formulation, seeds,
                   {'later': lambda result: rmse(result, LATER),
                    'anywhere': lambda result: rmse(result, ANYWHERE)})


def most_features(figures: Figures) -> np.ndarray:
    """Return each joint's largest number of features (N,)."""
    return np.array([result.model.n_features() for result in figures.fits]).max(axis=0)


def missing(figures: Figures, truth: np.ndarray) -> int:
    """Return the total number of true features above 0.1 N·m that the fits did not select."""
    return sum(int((~np.isin(np.flatnonzero(np.abs(truth[:, joint]) > LARGE),
                             torque.indices)).sum())
               for result in figures.fits for joint, torque in enumerate(result.model.torques))


def _joined(values: Iterable[float], form: str) -> str:
    return ' / '.join(format(value, form) for value in values)


def main() -> None:
    """Fit all formulations and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seeds', type=int, default=10)
    seeds, truth, poses, motion = range(parser.parse_args().seeds), exact_weights(), [], []
    for formulation in ('per_joint', 'potential', 'chain'):
        figures = table3(formulation, seeds)
        poses.append((formulation, _joined(100 * figures.worst('nrmse')[SHOWN], '.4f'),
                      _joined(most_features(figures)[SHOWN], 'd'), missing(figures, truth),
                      f'{figures.seconds:.2f}'))
        figures = eq17(formulation, seeds)
        motion.append((formulation, *(f'{figures.worst(which).max():.3f} '
                                      f'({figures.errors[which].max(axis=1).mean():.3f})'
                                      for which in ('later', 'anywhere')),
                       f'{figures.seconds:.2f}'))
    poses.insert(0, ('Yu 2022', _joined(PAPER['nrmse'], '.2f'), _joined(PAPER['features'], 'd'),
                     '–', '1.09 (3 joints)'))
    terminal.show(
        terminal.table(f'1000 random poses, 1 % noise, tested on Eq. (15): worst of {len(seeds)} '
                       f'seeds', ('J2 / J3 / J4', 'nRMSE %', 'features',
                                  f'features > {LARGE} N·m missed', 's a fit'), poses),
        terminal.table(f'100 s of Eq. (17), 0.1 N·m noise: RMSE of the worst joint, worst (mean) '
                       f'of {len(seeds)} seeds, N·m',
                       ('', 'same motion later', 'whole joint range', 's a fit'), motion))


if __name__ == '__main__':
    main()
