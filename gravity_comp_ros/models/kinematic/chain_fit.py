"""
The chain formulation: fit of a serial arm's gravity with unknown kinematics.

Search, noise, right angles, covariance. The search uses equal weights. Then each joint's noise is
estimated from its residual and the solution refined with the new weights, until both converge.
Autocorrelated residuals inflate the variance (`noise.correlation_time`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.kinematic.alternative_chains import (
    covariance_between, find_alternatives, least_certain_joint)
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_solver import (
    ChainProblem, Solution, solve, SolveOptions)
from gravity_comp_ros.models.kinematic.chain_starts import (
    FINAL_STRUCTURE_LIMIT, search, SearchOptions, SearchResult, structure)
from gravity_comp_ros.models.kinematic.known_axes import solve_known
from gravity_comp_ros.models.kinematic.right_angles import adopt_right_angles
import numpy as np

# Maximum number of noise estimates.
_ROUNDS = 6
# Steps from a given start under equal weights: a good start moves little, and the residual of a
# poor start would cause weights that keep it.
_NEAR = SolveOptions(max_steps=10, tolerance=1e-3)
# With fewer samples than this the residual of a wrong chain may be white: seek alternatives.
_FEW = 150
# Maximum number of searches for alternatives.
_SEARCHES = 3
# An alternative whose cost is lower by this share is another minimum.
_LOWER = 1e-3
# Initial noise, as a share of the largest torque. The result hardly depends on it.
_INITIAL_NOISE = 1e-2


@dataclass(frozen=True, eq=False)
class ChainFit:
    """
    A chain with the covariance (4N, 4N) of a step from it.

    `nuisance` (K,) are the coefficients of the nuisance columns and `nuisance_covariance` (K, K)
    their covariance, fitted jointly with gravity. `inflation` (N,) is each joint's variance
    inflation factor. `structure` compares the residual with white noise (`chain_starts`); `clean`
    is True if it is white. `square` (N,) counts the adopted right angles, or the known ones.
    `rivals` counts alternative chains of similar evidence.
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
class NuisanceDesign:
    """
    Nuisance columns fitted jointly with gravity, and robust weights of the samples.

    `columns` (K, N, M) are torques per unit of coefficient; `trust` (M, N) are weights of the
    squared residuals, 1 for inliers. `spread` (K,) are the prior standard deviations of the
    coefficients, per N·m of noise, infinite where they are free; None if all are free.
    """

    columns: FloatArray | None = None
    trust: FloatArray | None = None
    spread: FloatArray | None = None


def fit_chain(samples: JointSamples, options: SearchOptions = SearchOptions(),
              start: Chain | None = None, known: FloatArray | None = None,
              nuisance: NuisanceDesign = NuisanceDesign(), multi_start: bool = True) -> ChainFit:
    """
    Fit a chain to the torques of all joints.

    :param start: an initial chain, such as the arm's previous one.
    :param known: known axes (N, 3, 3), which need no search (`Geometry.rotations`).
    :param nuisance: nuisance columns, and robust weights of the samples.
    :param multi_start: whether other starts than `start` are tried.
    :raises FitError: if there are no samples.
    """
    problem = _problem(samples, nuisance)
    fit = (_search(problem, samples, options, start, nuisance.trust, multi_start)
           if known is None
           else _fit_known(problem, samples, known, nuisance.trust))
    return _with_nuisance(fit, problem, nuisance.trust)


def rough_fit(samples: JointSamples, options: SearchOptions | None, start: Chain | None = None,
              nuisance: NuisanceDesign = NuisanceDesign()) -> ChainFit:
    """
    Return the best minimum under its own noise, without right angles and alternatives.

    It precedes `fit_chain`, to identify friction, outliers and significant terms.

    :param options: None to refine `start` only.
    :raises FitError: if there are no samples.
    """
    problem = _problem(samples, nuisance)
    minimum = _first_minimum(problem, options, start)
    problem, solution, model, inflation = _refine_with_noise(problem, minimum.solution, samples,
                                                             nuisance.trust)
    covariance = np.asarray(np.linalg.inv(solution.precision))
    fit = ChainFit(solution.chain, covariance, model, inflation, minimum.starts,
                   solution.steps, 0.0, minimum.clean, ())
    return _with_nuisance(fit, problem, nuisance.trust)


def _problem(samples: JointSamples, nuisance: NuisanceDesign) -> ChainProblem:
    """Return the problem with equal initial weights."""
    tau = samples.tau
    if not tau.size:
        raise FitError('no samples to fit')
    sigma = max(_INITIAL_NOISE * float(np.sqrt((tau ** 2).mean(axis=0)).max()), 1e-9)
    weights = np.full(tau.shape, 1.0 / sigma)
    if nuisance.trust is not None:
        weights = weights * np.sqrt(nuisance.trust)
    return ChainProblem(samples.q, tau, weights, nuisance.columns, nuisance.spread)


def _with_nuisance(fit: ChainFit, problem: ChainProblem, trust: FloatArray | None) -> ChainFit:
    """Return the fit with the coefficients of the nuisance columns and their covariance."""
    if problem.nuisance is None:
        return fit
    sigma = fit.noise.sigma(fit.chain.torque(problem.q)) * np.sqrt(fit.inflation)
    weights = 1.0 / sigma if trust is None else np.sqrt(trust) / sigma
    problem = problem.with_weights(weights)
    rows = np.concatenate([fit.chain.jacobian(problem.q), problem.nuisance])
    rows *= problem.row_weights
    rows = rows.reshape(len(rows), -1)
    precision = rows @ rows.T
    n = len(rows) - problem.weighted_nuisance.count
    precision[:n, :n] += np.diag(problem.prior_precision())
    precision[n:, n:] += np.diag(problem.weighted_nuisance.precision())
    lengths = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    scaled = precision / np.outer(lengths, lengths)
    covariance = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True) / np.outer(lengths, lengths)
    return replace(fit, nuisance=problem.nuisance_coefficients(fit.chain),
                   nuisance_covariance=covariance[n:, n:])


def _first_minimum(problem: ChainProblem, options: SearchOptions | None,
                   start: Chain | None) -> SearchResult:
    """Return the best minimum of a search, or without options the one near `start`."""
    if options is None and start is not None:
        return SearchResult(solve(problem, start.axes, options=_NEAR), 0, False)
    return search(problem, options or SearchOptions(), None if start is None else start.axes)


def _search(problem: ChainProblem, samples: JointSamples, options: SearchOptions,
            start: Chain | None, trust: FloatArray | None, multi_start: bool) -> ChainFit:
    minimum = _first_minimum(problem, options if multi_start else None, start)
    problem, solution, model, inflation = _refine_with_noise(problem, minimum.solution, samples,
                                                             trust)
    final = adopt_right_angles(problem, solution)
    covariance, n_alternatives = final.covariance(), 0
    sigma = np.sqrt((model.sigma(final.solution.chain.torque(samples.q)) ** 2).mean(axis=0))
    is_uncertain = samples.n_samples < _FEW or least_certain_joint(
        final.solution.chain, covariance, sigma) is not None
    if is_uncertain and options.rivals:
        for _ in range(_SEARCHES):
            others = find_alternatives(problem, solution, options)
            if others[0].solution.cost >= (1.0 - _LOWER) * solution.cost:
                break
            problem, solution, model, inflation = _refine_with_noise(
                problem, others[0].solution, samples, trust)
        final, n_alternatives = adopt_right_angles(problem, solution), len(others) - 1
        covariance = final.covariance() + covariance_between(others, final.solution.chain)
    score = structure(problem, final.solution)
    return ChainFit(final.solution.chain, covariance, model, inflation, minimum.starts,
                    solution.steps, score, minimum.clean or score <= FINAL_STRUCTURE_LIMIT,
                    final.square, rivals=n_alternatives)


def _fit_known(problem: ChainProblem, samples: JointSamples, known: FloatArray,
               trust: FloatArray | None) -> ChainFit:
    first = solve_known(problem, known).solution
    problem, _, model, inflation = _refine_with_noise(problem, first, samples, trust)
    final = solve_known(problem, known)
    solution = final.solution
    score = structure(problem, solution)
    return ChainFit(solution.chain, final.covariance(), model, inflation, 0,
                    solution.steps, score, score <= FINAL_STRUCTURE_LIMIT, final.square)


def _refine_with_noise(problem: ChainProblem, solution: Solution, samples: JointSamples,
                       trust: FloatArray | None = None
                       ) -> tuple[ChainProblem, Solution, noise.NoiseModel, FloatArray]:
    """Estimate the noise and refine the solution in turn, until the noise converges."""
    floor = noise.floor(samples.tau)
    spent = solution.free.sum() + (0 if problem.nuisance is None else len(problem.nuisance))
    used = np.full(samples.n_joints, spent / samples.n_joints)
    root = np.ones(samples.tau.shape) if trust is None else np.sqrt(trust)
    last: noise.NoiseModel | None = None
    for _ in range(_ROUNDS):
        predicted = solution.chain.torque(samples.q)
        residual = problem.residual(solution.chain) * root
        model = noise.estimate(residual, predicted, floor, used)
        times = noise.correlation_times(residual, samples.runs)
        inflation = np.where(times < noise.WHITE, 1.0, times)
        if last is not None and model.is_close_to(last):
            break
        weights = root / (model.sigma(predicted) * np.sqrt(inflation))
        problem = problem.with_weights(weights)
        solution, last = solve(problem, solution.chain.axes, solution.free), model
    return problem, solution, model, inflation
