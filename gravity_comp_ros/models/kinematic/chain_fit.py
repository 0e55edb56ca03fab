"""
The chain formulation: gravity of a serial arm with unknown kinematics.

Search, noise, right angles, covariance. The search runs with equal weights; then each joint's
noise is learned from its residual and the solution refined under it, until neither changes.
Where the residual is correlated in time, samples count for less (`noise.correlation_time`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.kinematic.alternative_chains import (
    find_rivals, spread_of, unsure_joint)
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_solver import (
    ChainProblem, Solution, solve, SolveOptions)
from gravity_comp_ros.models.kinematic.chain_starts import (
    Found, LIMIT, search, SearchOptions, structure)
from gravity_comp_ros.models.kinematic.known_axes import solve_known
from gravity_comp_ros.models.kinematic.right_angles import tidy
import numpy as np

_ROUNDS = 6
# How far a given start is brought under equal weights: a good one moves little, and what is left
# of a poor one would make weights that keep it where it is.
_NEAR = SolveOptions(max_steps=10, tolerance=1e-3)
# Of fewer samples than this a wrong chain leaves what looks like noise, so others are sought.
_FEW = 150
_SEARCHES = 3
# A rival whose cost is less by this share is another minimum, not the same one again.
_BETTER = 1e-3
# The first guess of the noise, as a share of the largest torque: it matters little.
_FIRST = 1e-2
# Shorter correlation times than this are what chance makes of white noise.
_WHITE = 2.0


@dataclass(frozen=True, eq=False)
class ChainFit:
    """
    A chain with the covariance (4N, 4N) of a step from it, and how it came about.

    `nuisance` (K,) are the coefficients of the nuisance columns, `nuisance_covariance` (K, K) is
    theirs, gravity fitted beside. `inflation` (N,) says how many samples of each joint count as
    one. `structure` is what features
    explain of the residual beyond what they do of noise, in standard deviations; `clean` says
    that it is nothing. `square` (N,) counts the angles taken as right, or as known. `rivals`
    counts other chains that explain the samples as well, or nearly.
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
    rivals: int = 0
    nuisance: FloatArray = field(default_factory=lambda: np.zeros(0))
    nuisance_covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class Beside:
    """
    What is fitted beside gravity, and how far each sample is trusted.

    `columns` (K, N, M) are torques per unit of coefficient; `trust` (M, N) weighs squared
    residuals, 1 where a sample is trusted. `spread` (K,) are standard deviations of the
    coefficients before any data, per N·m of noise, infinite where they are free; None if all are.
    """

    columns: FloatArray | None = None
    trust: FloatArray | None = None
    spread: FloatArray | None = None


def fit_chain(samples: JointSamples, options: SearchOptions = SearchOptions(),
              start: Chain | None = None, known: FloatArray | None = None,
              beside: Beside = Beside(), search_anew: bool = True) -> ChainFit:
    """
    Fit a chain to the torques of all joints.

    :param start: a chain to begin with, such as the arm's last one.
    :param known: axes (N, 3, 3) that need no search (`Geometry.rotations`).
    :param beside: nuisance columns, and how far samples are trusted.
    :param search_anew: whether other starts than `start` are tried.
    :raises FitError: if there are no samples.
    """
    problem = _problem(samples, beside)
    found = (_search(problem, samples, options, start, beside.trust, search_anew)
             if known is None
             else _fit_known(problem, samples, known, beside.trust))
    return _with_nuisance(found, problem, beside.trust)


def rough_fit(samples: JointSamples, options: SearchOptions | None, start: Chain | None = None,
              beside: Beside = Beside()) -> ChainFit:
    """
    Return the best minimum under its own noise, without right angles and alternatives.

    It serves to find friction, outliers and the terms that matter, before `fit_chain`.

    :param options: None to go on from `start` alone.
    :raises FitError: if there are no samples.
    """
    problem = _problem(samples, beside)
    found = _started(problem, options, start)
    problem, solution, model, inflation = _settle_noise(problem, found.solution, samples,
                                                        beside.trust)
    covariance = np.asarray(np.linalg.inv(solution.precision))
    fitted = ChainFit(solution.chain, covariance, model, inflation, found.starts,
                      solution.steps, 0.0, found.clean, ())
    return _with_nuisance(fitted, problem, beside.trust)


def _problem(samples: JointSamples, beside: Beside) -> ChainProblem:
    """Return the problem with equal weights, to begin with."""
    tau = samples.tau
    if not tau.size:
        raise FitError('no samples to fit')
    first = max(_FIRST * float(np.sqrt((tau ** 2).mean(axis=0)).max()), 1e-9)
    weights = np.full(tau.shape, 1.0 / first)
    if beside.trust is not None:
        weights = weights * np.sqrt(beside.trust)
    return ChainProblem(samples.q, tau, weights, beside.columns, beside.spread)


def _with_nuisance(found: ChainFit, problem: ChainProblem,
                   trust: FloatArray | None) -> ChainFit:
    """Return the fit with the coefficients of the nuisance columns and their covariance."""
    if problem.nuisance is None:
        return found
    sigma = found.noise.sigma(found.chain.torque(problem.q)) * np.sqrt(found.inflation)
    weights = 1.0 / sigma if trust is None else np.sqrt(trust) / sigma
    problem = problem.with_weights(weights)
    every = np.concatenate([found.chain.jacobian(problem.q), problem.nuisance])
    every *= problem.row_weights
    every = every.reshape(len(every), -1)
    precision = every @ every.T
    n = len(every) - problem.beside.count
    precision[:n, :n] += np.diag(problem.prior_precision())
    precision[n:, n:] += np.diag(problem.beside.precision())
    lengths = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    scaled = precision / np.outer(lengths, lengths)
    covariance = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True) / np.outer(lengths, lengths)
    return replace(found, nuisance=problem.nuisance_coefficients(found.chain),
                   nuisance_covariance=covariance[n:, n:])


def _started(problem: ChainProblem, options: SearchOptions | None, start: Chain | None) -> Found:
    """Return the best minimum of a search, or what is near `start`, to refine under its noise."""
    if options is None and start is not None:
        return Found(solve(problem, start.axes, options=_NEAR), 0, False)
    return search(problem, options or SearchOptions(), None if start is None else start.axes)


def _search(problem: ChainProblem, samples: JointSamples, options: SearchOptions,
            start: Chain | None, trust: FloatArray | None, search_anew: bool) -> ChainFit:
    q = samples.q
    found = _started(problem, options if search_anew else None, start)
    problem, solution, model, inflation = _settle_noise(problem, found.solution, samples, trust)
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
                                                                samples, trust)
        tidied, rivals = tidy(problem, solution), len(others) - 1
        covariance = tidied.covariance() + spread_of(others, tidied.solution.chain)
    left = structure(problem, tidied.solution)
    return ChainFit(tidied.solution.chain, covariance, model, inflation, found.starts,
                    solution.steps, left, found.clean or left <= LIMIT, tidied.square,
                    rivals=rivals)


def _typical(model: noise.NoiseModel, predicted: FloatArray) -> FloatArray:
    """Return each joint's noise (N,), root mean square over the samples."""
    return np.asarray(np.sqrt((model.sigma(predicted) ** 2).mean(axis=0)))


def _fit_known(problem: ChainProblem, samples: JointSamples, known: FloatArray,
               trust: FloatArray | None) -> ChainFit:
    first = solve_known(problem, known).solution
    problem, solution, model, inflation = _settle_noise(problem, first, samples, trust)
    found = solve_known(problem, known)
    solution = found.solution
    left = structure(problem, solution)
    return ChainFit(solution.chain, found.covariance(), model, inflation, 0,
                    solution.steps, left, left <= LIMIT, found.square)


def _settle_noise(problem: ChainProblem, solution: Solution, samples: JointSamples,
                  trust: FloatArray | None = None
                  ) -> tuple[ChainProblem, Solution, noise.NoiseModel, FloatArray]:
    """Refine the solution and the noise in turn, until the noise stays."""
    least = noise.floor(samples.tau)
    spent = solution.free.sum() + (0 if problem.nuisance is None else len(problem.nuisance))
    used = np.full(samples.n_joints, spent / samples.n_joints)
    root = np.ones(samples.tau.shape) if trust is None else np.sqrt(trust)
    last: noise.NoiseModel | None = None
    for _ in range(_ROUNDS):
        predicted = solution.chain.torque(samples.q)
        residual = problem.residual(solution.chain) * root
        model = noise.estimate(residual, predicted, least, used)
        inflation = _inflation(residual, samples)
        if last is not None and model.is_close_to(last):
            break
        weights = root / (model.sigma(predicted) * np.sqrt(inflation))
        problem = problem.with_weights(weights)
        solution, last = solve(problem, solution.chain.axes, solution.free), model
    return problem, solution, model, inflation


def _inflation(residual: FloatArray, samples: JointSamples) -> FloatArray:
    times = np.array([noise.correlation_time(column, samples.runs) for column in residual.T])
    return np.where(times < _WHITE, 1.0, times)
