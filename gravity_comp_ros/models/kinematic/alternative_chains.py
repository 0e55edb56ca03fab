"""
Alternative chains: other minima that explain the same samples.

A few seconds of motion are consistent with more than one chain, and the first one with a white
residual need not be the true one. Where the torque elsewhere is uncertain, further minima are
sought and ranked by their evidence (Laplace's approximation of the marginal likelihood). The most
probable one is the result; the differences of the others are added to its covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_solver import (
    ChainProblem, COARSE, Solution, solve)
from gravity_comp_ros.models.kinematic.chain_starts import next_axes, SearchOptions, thinned
from gravity_comp_ros.models.uncertainty import ChainUncertainty
import numpy as np

# A fit is certain if its standard deviation over all poses is below this share of the noise.
_CERTAIN = 0.67
# It is uncertain if known axes would reduce the standard deviation by this factor, or if it
# exceeds this multiple of the noise.
_REDUCTION, _LARGE = 2.0, 2.0
# Log-evidence deficit beyond which a minimum is ignored.
_NEGLIGIBLE = 12.0
# Half chi^2 by which refining may still lower a coarse minimum.
_REFINING_GAIN = 30.0
# Two minima are the same if their torques differ by less than this share of the noise.
_SAME = 0.1
# Number of poses that represent the whole joint range.
_POSES = 200


@dataclass(frozen=True)
class Alternative:
    """A minimum and the logarithm of its evidence."""

    solution: Solution
    log_evidence: float


def all_poses(n_joints: int) -> FloatArray:
    """Return poses (P, N) in rad over the whole joint range, the same at every call."""
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, n_joints))


def std_over_poses(chain: Chain, covariance: FloatArray) -> FloatArray:
    """Return each joint's standard deviation (N,) in N·m, root mean square over all poses."""
    std = ChainUncertainty(chain, covariance).std(all_poses(chain.n_joints))
    return np.asarray(np.sqrt((std ** 2).mean(axis=0)))


def std_with_known_axes(chain: Chain, covariance: FloatArray) -> FloatArray:
    """Return the same as `std_over_poses`, conditioned on the axes."""
    half = 2 * chain.n_joints
    known = np.zeros_like(covariance)
    axes, cross, moments = covariance[:half, :half], covariance[:half, half:], \
        covariance[half:, half:]
    # After an update the covariance may be singular.
    known[half:, half:] = moments - cross.T @ np.linalg.pinv(axes, hermitian=True) @ cross
    return std_over_poses(chain, known)


def least_certain_joint(chain: Chain, covariance: FloatArray, noise: FloatArray) -> int | None:
    """Return the joint with the largest relative torque uncertainty; None if all are certain."""
    std = std_over_poses(chain, covariance)
    worst = int(np.argmax(std / noise))
    relative = std[worst] / noise[worst]
    reduction = std[worst] / max(float(std_with_known_axes(chain, covariance)[worst]), 1e-300)
    is_certain = relative <= _CERTAIN or (relative <= _LARGE and reduction <= _REDUCTION)
    return None if is_certain else worst


def find_alternatives(problem: ChainProblem, first: Solution,
                      options: SearchOptions = SearchOptions()) -> list[Alternative]:
    """Return the relevant minima, `first` among them, in order of falling evidence."""
    few = thinned(problem)
    share = problem.tau.size / few.tau.size
    rng = np.random.default_rng([options.seed, 1])
    sigma = 1.0 / problem.weights.mean(axis=0)
    minima = [_alternative(solve(problem, first.chain.axes))]
    best = solve(few, minima[0].solution.chain.axes, options=COARSE)
    for count in range(1, options.rivals + 1):
        coarse = solve(few, next_axes(rng, problem.n_joints, count, best), options=COARSE)
        if 0.5 * share * (coarse.cost - best.cost) > _REFINING_GAIN:
            continue
        best = coarse if coarse.cost < best.cost else best
        new = _alternative(solve(problem, coarse.chain.axes))
        if all(_differ(new.solution.chain, other.solution.chain, sigma) for other in minima):
            minima.append(new)
    minima.sort(key=lambda each: -each.log_evidence)
    return [each for each in minima
            if minima[0].log_evidence - each.log_evidence < _NEGLIGIBLE]


def covariance_between(alternatives: list[Alternative], chain: Chain) -> FloatArray:
    """
    Return the covariance (4N, 4N) that alternatives add to a step from `chain`, the first of them.

    Each alternative contributes the step whose torque change over all poses is closest to its own,
    scaled to the same size, weighted with its posterior probability.
    """
    n = chain.n_joints
    added = np.zeros((4 * n, 4 * n))
    if len(alternatives) < 2:
        return added
    weights = np.exp([each.log_evidence - alternatives[0].log_evidence for each in alternatives])
    weights /= weights.sum()
    q = all_poses(n)
    columns = chain.jacobian(q).reshape(4 * n, -1)
    gram = columns @ columns.T
    gram.flat[::len(gram) + 1] += 1e-6 * np.trace(gram) / len(gram) + 1e-12
    for weight, other in zip(weights[1:], alternatives[1:]):
        difference = (other.solution.chain.torque(q) - chain.torque(q)).T.ravel()
        step = np.linalg.solve(gram, columns @ difference)
        size = np.linalg.norm(step @ columns)
        if size > 0.0:
            step *= np.linalg.norm(difference) / size
        added += weight * np.outer(step, step)
    return added


def _alternative(solution: Solution) -> Alternative:
    _, log_det = np.linalg.slogdet(solution.precision)
    return Alternative(solution, float(-0.5 * solution.cost - 0.5 * log_det))


def _differ(one: Chain, other: Chain, sigma: FloatArray) -> bool:
    q = all_poses(one.n_joints)
    difference = (one.torque(q) - other.torque(q)) / sigma
    return bool(np.sqrt((difference ** 2).mean(axis=0)).max() > _SAME)
