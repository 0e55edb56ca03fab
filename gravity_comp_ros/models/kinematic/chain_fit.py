"""
The chain formulation: gravity of a serial arm whose kinematics nobody has told.

Search, noise, right angles, covariance. The search runs with equal weights; then each joint's
noise is learned from its residual and the solution refined under it, until neither changes.
Where the residual is correlated in time, samples count for less (`noise.correlation_time`).
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.kinematic.alternative_chains import (
    find_rivals, spread_of, unsure_joint)
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Solution, solve
from gravity_comp_ros.models.kinematic.chain_starts import LIMIT, search, SearchOptions, structure
from gravity_comp_ros.models.kinematic.known_axes import solve_known
from gravity_comp_ros.models.kinematic.right_angles import tidy
import numpy as np

_ROUNDS = 6
# Of fewer samples than this a wrong chain leaves what looks like noise, so others are sought.
_FEW = 150
_SEARCHES = 3
# A rival whose cost is less by this share is another minimum, not the same one again.
_BETTER = 1e-3
# The first guess of the noise, as a share of the largest torque: it matters little.
_FIRST = 1e-2
# Shorter correlation times than this are what chance makes of white noise.
_WHITE = 2.0


@dataclass(frozen=True)
class ChainFit:
    """
    A chain with the covariance (4N, 4N) of a step from it, and how it came about.

    `inflation` (N,) says how many samples of each joint count as one. `structure` is what features
    explain of the residual beyond what they do of noise, in standard deviations; `clean` says
    that it is nothing. `square` (N,) counts the angles taken as right, or as known; `tilt` in rad
    is how far the base stands from where known axes put it. `rivals` counts other chains that
    explain the samples as well, or nearly.
    """

    chain: Chain
    covariance: FloatArray
    noise: noise.NoiseModel
    inflation: FloatArray
    starts: int
    steps: int
    structure: float
    clean: bool
    square: tuple[int, ...]
    tilt: float = 0.0
    rivals: int = 0


def fit_chain(samples: JointSamples, options: SearchOptions = SearchOptions(),
              start: Chain | None = None, known: FloatArray | None = None) -> ChainFit:
    """
    Fit a chain to the torques of all joints.

    :param start: a chain to begin with, such as the arm's last one.
    :param known: axes (N, 3, 3) that need no search (`Geometry.rotations`).
    :raises FitError: if there are no samples.
    """
    q, tau = samples.q, samples.tau
    if not tau.size:
        raise FitError('no samples to fit')
    first = max(_FIRST * float(np.sqrt((tau ** 2).mean(axis=0)).max()), 1e-9)
    problem = ChainProblem(q, tau, np.full(tau.shape, 1.0 / first))
    if known is not None:
        return _fit_known(problem, samples, known)
    found = search(problem, options, None if start is None else start.axes)
    problem, solution, model, inflation = _settle_noise(problem, found.solution, samples)
    tidied = tidy(problem, solution)
    covariance, rivals = tidied.covariance(), 0
    sigma = _typical(model, tidied.solution.chain.torque(q))
    unsure = samples.n_samples < _FEW or unsure_joint(tidied.solution.chain, covariance,
                                                      sigma) is not None
    if unsure and options.rivals:
        for _ in range(_SEARCHES):
            others = find_rivals(problem, solution, options)
            if others[0].solution.cost >= (1.0 - _BETTER) * solution.cost:
                break
            problem, solution, model, inflation = _settle_noise(problem, others[0].solution,
                                                                samples)
        tidied, rivals = tidy(problem, solution), len(others) - 1
        covariance = tidied.covariance() + spread_of(others, tidied.solution.chain)
    left = structure(problem, tidied.solution)
    return ChainFit(tidied.solution.chain, covariance, model, inflation, found.starts,
                    solution.steps, left, found.clean or left <= LIMIT, tidied.square,
                    rivals=rivals)


def _typical(model: noise.NoiseModel, predicted: FloatArray) -> FloatArray:
    """Return each joint's noise (N,), root mean square over the samples."""
    return np.asarray(np.sqrt((model.sigma(predicted) ** 2).mean(axis=0)))


def _fit_known(problem: ChainProblem, samples: JointSamples, known: FloatArray) -> ChainFit:
    first = solve_known(problem, known).tidied.solution
    problem, solution, model, inflation = _settle_noise(problem, first, samples)
    found = solve_known(problem, known)
    solution = found.tidied.solution
    left = structure(problem, solution)
    return ChainFit(solution.chain, found.tidied.covariance(), model, inflation, 0,
                    solution.steps, left, left <= LIMIT, found.tidied.square, found.tilt)


def _settle_noise(problem: ChainProblem, solution: Solution, samples: JointSamples
                  ) -> tuple[ChainProblem, Solution, noise.NoiseModel, FloatArray]:
    """Refine the solution and the noise in turn, until the noise stays."""
    least = noise.floor(samples.tau)
    used = np.full(samples.n_joints, solution.free.sum() / samples.n_joints)
    last: noise.NoiseModel | None = None
    for _ in range(_ROUNDS):
        predicted = solution.chain.torque(samples.q)
        residual = samples.tau - predicted
        model = noise.estimate(residual, predicted, least, used)
        inflation = _inflation(residual, samples)
        if last is not None and model.is_close_to(last):
            break
        weights = 1.0 / (model.sigma(predicted) * np.sqrt(inflation))
        problem = ChainProblem(samples.q, samples.tau, weights)
        solution, last = solve(problem, solution.chain.axes, solution.free), model
    return problem, solution, model, inflation


def _inflation(residual: FloatArray, samples: JointSamples) -> FloatArray:
    times = np.array([noise.correlation_time(column, samples.runs) for column in residual.T])
    return np.where(times < _WHITE, 1.0, times)
