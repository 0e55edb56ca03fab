"""
Rough fit of a serial arm's gravity with unknown kinematics, as the start of a regression.

The search uses equal weights. Then each joint's noise is estimated from its residual and the
solution refined with the new weights, until both converge.

The cost has several minima. A local one is recognised by its residual: features of the dictionary
still explain part of it, while that of the global minimum is white. Minima are sought from random
axes, and from the best axes with one or two of them replaced (most local minima have one wrong
axis), until a residual is white or the starts are used up. A start takes some tens of ms on 200
samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError, OptionError
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.kinematic.chain import aligned, Chain, in_frames_of_axes
from gravity_comp_ros.models.kinematic.chain_solver import (
    ChainProblem, Nuisance, Solution, solve, SolveOptions)
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.models.sparse.lasso import column_lengths, has_length
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np

# Number of samples for a coarse solution.
_COARSE_SAMPLES = 200
# A global minimum moves little when the weights change, so a few steps suffice.
_NEAR = SolveOptions(max_steps=6)
# Number of starts from random axes before the best axes are varied.
_RANDOM = 4
# The best minimum is accepted after this number of further starts reached it, within this share of
# its cost: with friction or an unmodelled effect no residual is white.
_HITS, _SAME_MINIMUM = 3, 0.02
# Number of noise draws to compare a residual with, and of samples for the comparison.
_DRAWS, _COMPARED = 16, 500
# Limit of `structure` for white residuals. Global minima have -3 to -5 (fitting removed part of
# the noise), local ones 1 to 30.
STRUCTURE_LIMIT = 0.0
_MAX_REWEIGHTINGS = 2
# Limit of the lag-1 autocorrelation of white noise, in standard deviations.
_WHITE = 4.0


@dataclass(frozen=True)
class SearchOptions:
    """
    Extent of the search: at most `starts` starts, drawn from `seed`.

    :raises OptionError: if `starts` is below 1.
    """

    starts: int
    seed: int = 0

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise OptionError(f'chain: starts is {self.starts}; it must be at least 1')


@dataclass(frozen=True)
class SearchResult:
    """A minimum of the full problem, and whether its residual is white."""

    solution: Solution
    clean: bool


def search(problem: ChainProblem, options: SearchOptions) -> SearchResult:
    """Return the best minimum of all starts."""
    few = thinned(problem)
    rng = np.random.default_rng(options.seed)
    best: Solution | None = None
    hits = 0
    for count in range(1, options.starts + 1):
        tried = solve(few, next_axes(rng, problem.n_joints, count, best))
        if best is not None and tried.cost >= (1.0 - 1e-3) * best.cost:
            hits += tried.cost <= (1.0 + _SAME_MINIMUM) * best.cost
            if hits >= _HITS:
                break
            continue
        # A slightly lower cost is the same minimum again.
        hits = hits + 1 if best is not None and tried.cost >= (
            1.0 - _SAME_MINIMUM) * best.cost else 0
        best = tried
        if not _is_clean(few, tried):
            continue
        result = _refined(problem, best)
        if result.clean:
            return result
    assert best is not None
    return _refined(problem, best)


def structure(problem: ChainProblem, solution: Solution) -> float:
    """
    Return the structure of a residual: the excess of its part in the dictionary over white noise.

    The statistic is the logarithm of sum_k (A_k . r)^2 / |A_k|^2 over all 3^N features of an
    energy, each joint in units of its own residual. The result is its difference from the mean
    over draws of white noise, in standard deviations of the draws.
    """
    problem = thinned(problem, _COMPARED)
    residual = problem.residual(solution.chain)
    spread = _rms(problem, residual)
    design = EnergyDesign(problem.q, np.broadcast_to(1.0 / spread, residual.shape))
    lengths = column_lengths(design)
    kept = has_length(lengths)

    def explained(unit: FloatArray) -> float:
        score = design.correlate(unit.T.ravel())[kept] / lengths[kept]
        return float(np.log(max(float(score @ score), 1e-300)))

    rng = np.random.default_rng(0)
    noise = np.array([explained(rng.normal(size=residual.shape)) for _ in range(_DRAWS)])
    return float((explained(residual / spread) - noise.mean()) / noise.std(ddof=1))


def thinned(problem: ChainProblem, count: int = _COARSE_SAMPLES) -> ChainProblem:
    """Return the problem of evenly picked samples, at most `count`."""
    if len(problem.q) <= count:
        return problem
    return problem.select(np.linspace(0, len(problem.q) - 1, count).astype(int))


def _refined(problem: ChainProblem, coarse: Solution) -> SearchResult:
    """Return the minimum of the full problem near a coarse one."""
    solution = solve(problem, coarse.chain.axes)
    return SearchResult(solution, _is_clean(problem, solution))


def _is_clean(problem: ChainProblem, solution: Solution) -> bool:
    """
    Return whether the residual is white once each joint is weighted by its own residual.

    Under equal weights a noisy joint causes errors of a quiet one that look like structure.
    """
    for count in range(_MAX_REWEIGHTINGS + 1):
        if count:
            residual = problem.residual(solution.chain)
            problem = problem.with_weights(
                np.broadcast_to(1.0 / _rms(problem, residual), residual.shape))
            solution = solve(problem, solution.chain.axes, options=_NEAR)
        # The autocorrelation is tested first because it is much cheaper.
        if is_white(problem, solution) and structure(problem, solution) <= STRUCTURE_LIMIT:
            return True
    return False


def _rms(problem: ChainProblem, residual: FloatArray) -> FloatArray:
    """Return each joint's residual RMS (N,) in N·m, at least the noise floor."""
    return np.asarray(np.maximum(np.sqrt((residual ** 2).mean(axis=0)), floor(problem.tau)))


def is_white(problem: ChainProblem, solution: Solution) -> bool:
    """Return whether the lag-1 autocorrelation of every joint's residual is that of noise."""
    residual = problem.residual(solution.chain)
    power = np.maximum((residual ** 2).sum(axis=0), len(residual) * floor(problem.tau) ** 2)
    autocorrelation = (residual[1:] * residual[:-1]).sum(axis=0) / power
    return bool(autocorrelation.max(initial=0.0) < _WHITE / np.sqrt(len(residual)))


def next_axes(rng: np.random.Generator, n: int, count: int, best: Solution | None
              ) -> FloatArray:
    """Return random axes, or the best ones with one or two of them replaced."""
    random_axes = _random_axes(rng, n)
    if best is None or count <= _RANDOM or rng.random() < 0.25:
        return np.stack(list(random_axes))
    axes = best.chain.axes.copy()
    for j in rng.choice(n, size=min(n, int(rng.integers(1, 3))), replace=False):
        axes[j] = axes[j] @ next(random_axes)
    return axes


def _random_axes(rng: np.random.Generator, n: int) -> Iterator[FloatArray]:
    """Yield n rotations that take z to a random direction."""
    for direction in rng.normal(size=(n, 3)):
        yield aligned(direction / np.linalg.norm(direction))


# Maximum number of noise estimates.
_ROUNDS = 6
# Initial noise, as a share of the largest torque. The result hardly depends on it.
_INITIAL_NOISE = 1e-2


@dataclass(frozen=True, eq=False)
class ChainFit:
    """A chain, the noise of its residual, and whether the residual is white (`clean`)."""

    chain: Chain
    noise: noise.NoiseModel
    clean: bool


def rough_fit(samples: JointSamples, nuisance: Nuisance, options: SearchOptions) -> ChainFit:
    """
    Return the best minimum under its own noise, in the frames of its axes.

    :raises FitError: if there are no samples.
    """
    problem = _problem(samples, nuisance)
    minimum = search(problem, options)
    solution, model = _refine_with_noise(problem, minimum.solution, samples)
    return ChainFit(in_frames_of_axes(solution.chain), model, minimum.clean)


def _problem(samples: JointSamples, nuisance: Nuisance) -> ChainProblem:
    """Return the problem with equal initial weights."""
    tau = samples.tau
    if not tau.size:
        raise FitError('no samples to fit')
    sigma = max(_INITIAL_NOISE * float(np.sqrt((tau ** 2).mean(axis=0)).max()), 1e-9)
    return ChainProblem(samples.q, tau, np.full(tau.shape, 1.0 / sigma), nuisance)


def _refine_with_noise(problem: ChainProblem, solution: Solution, samples: JointSamples
                       ) -> tuple[Solution, noise.NoiseModel]:
    """Estimate the noise and refine the solution in turn, until the noise converges."""
    floor = noise.floor(samples.tau)
    assert problem.nuisance is not None
    used = np.full(samples.n_joints, len(solution.free) / samples.n_joints
                   + len(problem.nuisance.spread))
    last: noise.NoiseModel | None = None
    for _ in range(_ROUNDS):
        predicted = solution.chain.torque(samples.q)
        residual = problem.residual(solution.chain)
        model = noise.estimate(residual, predicted, floor, used)
        inflation = noise.inflation(residual, samples.runs)
        if last is not None and model.is_close_to(last):
            break
        problem = problem.with_weights(1.0 / (model.sigma(predicted) * np.sqrt(inflation)))
        solution, last = solve(problem, solution.chain.axes), model
    return solution, model
