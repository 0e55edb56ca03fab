"""
Rough fit of a serial arm's gravity with unknown kinematics, as the start of a regression.

The search uses equal weights. Then each joint's noise is estimated from its residual and the
solution refined with the new weights, until both converge.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Solution, solve
from gravity_comp_ros.models.kinematic.chain_starts import search, SearchOptions
import numpy as np

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


def rough_fit(samples: JointSamples, options: SearchOptions = SearchOptions(),
              start: Chain | None = None, nuisance: NuisanceDesign = NuisanceDesign()) -> ChainFit:
    """
    Return the best minimum under its own noise.

    :param start: a chain whose axes are tried first.
    :raises FitError: if there are no samples.
    """
    problem = _problem(samples, nuisance)
    minimum = search(problem, options, None if start is None else start.axes)
    solution, model = _refine_with_noise(problem, minimum.solution, samples, nuisance.trust)
    return ChainFit(solution.chain, model, minimum.clean)


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


def _refine_with_noise(problem: ChainProblem, solution: Solution, samples: JointSamples,
                       trust: FloatArray | None) -> tuple[Solution, noise.NoiseModel]:
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
    return solution, model
