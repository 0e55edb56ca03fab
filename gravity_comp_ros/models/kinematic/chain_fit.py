"""
Rough fit of a serial arm's gravity with unknown kinematics, as the start of a regression.

The search uses equal weights. Then each joint's noise is estimated from its residual and the
solution refined with the new weights, until both converge.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.kinematic.chain import Chain, in_frames_of_axes
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Solution, solve
from gravity_comp_ros.models.kinematic.chain_starts import search, SearchOptions
from gravity_comp_ros.models.kinematic.nuisance import Nuisance
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
        times = noise.correlation_times(residual, samples.runs)
        inflation = np.where(times < noise.WHITE, 1.0, times)
        if last is not None and model.is_close_to(last):
            break
        problem = problem.with_weights(1.0 / (model.sigma(predicted) * np.sqrt(inflation)))
        solution, last = solve(problem, solution.chain.axes), model
    return solution, model
