"""
Other chains that explain the same samples.

Seconds of motion are explained by more than one chain, and the first that leaves noise alone need
not be the right one. Where a fit is unsure of the torque elsewhere, further minima are sought,
each is weighed by its evidence (Laplace's approximation of the probability of the samples), the
likeliest is taken, and what the others say differently is added to its uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_solver import (
    ChainProblem, Solution, solve, SolveOptions)
from gravity_comp_ros.models.kinematic.chain_starts import next_axes, SearchOptions, thinned
from gravity_comp_ros.models.uncertainty import ChainUncertainty
import numpy as np

# Below this share of the noise a standard deviation anywhere leaves a fit sure.
_UNSURE = 0.67
_ROUGH = SolveOptions(max_steps=60, tolerance=1e-4)
# Minima whose log evidence is this much less count for nothing.
_NEGLIGIBLE = 12.0
# A rough minimum may still fall by about this much (half chi^2) when it is refined.
_MAY_FALL = 30.0
# Minima whose torques differ by less than this share of the noise, anywhere, are the same.
_SAME = 0.1
_POSES = 200
# A fit is said to be unsure where knowing the axes would halve its standard deviation, or where
# that is this many times the noise.
_HALVED, _LARGE = 2.0, 2.0


@dataclass(frozen=True)
class Rival:
    """A minimum and the logarithm of its evidence."""

    solution: Solution
    log_evidence: float


def anywhere(n_joints: int) -> FloatArray:
    """Return poses (P, N) anywhere, the same at every call."""
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSES, n_joints))


def std_anywhere(chain: Chain, covariance: FloatArray) -> FloatArray:
    """Return each joint's standard deviation (N,) in N·m, root mean square over all poses."""
    std = ChainUncertainty(chain, covariance).std(anywhere(chain.n_joints))
    return np.asarray(np.sqrt((std ** 2).mean(axis=0)))


def std_of_moments(chain: Chain, covariance: FloatArray) -> FloatArray:
    """Return the same as `std_anywhere`, if somebody told the axes."""
    half = 2 * chain.n_joints
    known = np.zeros_like(covariance)
    # Conditioned on the axes; after an update the covariance may be singular.
    axes, cross, moments = covariance[:half, :half], covariance[:half, half:], \
        covariance[half:, half:]
    known[half:, half:] = moments - cross.T @ np.linalg.pinv(axes, hermitian=True) @ cross
    return std_anywhere(chain, known)


def unsure_joint(chain: Chain, covariance: FloatArray, noise: FloatArray) -> int | None:
    """Return the joint whose torque the fit is most unsure of, anywhere; None if it is sure."""
    std = std_anywhere(chain, covariance)
    worst = int(np.argmax(std / noise))
    relative = std[worst] / noise[worst]
    gained = std[worst] / max(float(std_of_moments(chain, covariance)[worst]), 1e-300)
    is_sure = relative <= _UNSURE or (relative <= _LARGE and gained <= _HALVED)
    return None if is_sure else worst


def find_rivals(problem: ChainProblem, first: Solution,
                options: SearchOptions = SearchOptions()) -> list[Rival]:
    """Return the minima that count, `first` among them, the likeliest first."""
    few = thinned(problem)
    share = problem.tau.size / few.tau.size
    rng = np.random.default_rng([options.seed, 1])
    sigma = 1.0 / problem.weights.mean(axis=0)
    found = [_rival(solve(problem, first.chain.axes))]
    best = solve(few, found[0].solution.chain.axes, options=_ROUGH)
    for count in range(1, options.rivals + 1):
        rough = solve(few, next_axes(rng, problem.n_joints, count, best), options=_ROUGH)
        if 0.5 * share * (rough.cost - best.cost) > _MAY_FALL:
            continue
        best = rough if rough.cost < best.cost else best
        rival = _rival(solve(problem, rough.chain.axes))
        if all(_differ(rival.solution.chain, other.solution.chain, sigma) for other in found):
            found.append(rival)
    found.sort(key=lambda each: -each.log_evidence)
    return [each for each in found
            if found[0].log_evidence - each.log_evidence < _NEGLIGIBLE]


def spread_of(rivals: list[Rival], chain: Chain) -> FloatArray:
    """
    Return what rivals add to the covariance (4N, 4N) of a step from `chain`, the first of them.

    Each differs from it by a step that changes torques anywhere as the rival does, as nearly and
    as much as a step can; it counts as often as the rival is likely.
    """
    n = chain.n_joints
    added = np.zeros((4 * n, 4 * n))
    if len(rivals) < 2:
        return added
    weights = np.exp([each.log_evidence - rivals[0].log_evidence for each in rivals])
    weights /= weights.sum()
    q = anywhere(n)
    columns = chain.jacobian(q).reshape(4 * n, -1)
    gram = columns @ columns.T
    gram.flat[::len(gram) + 1] += 1e-6 * np.trace(gram) / len(gram) + 1e-12
    for weight, rival in zip(weights[1:], rivals[1:]):
        apart = (rival.solution.chain.torque(q) - chain.torque(q)).T.ravel()
        step = np.linalg.solve(gram, columns @ apart)
        reached = np.linalg.norm(step @ columns)
        if reached > 0.0:
            step *= np.linalg.norm(apart) / reached
        added += weight * np.outer(step, step)
    return added


def _rival(solution: Solution) -> Rival:
    _, log_det = np.linalg.slogdet(solution.precision)
    return Rival(solution, float(-0.5 * solution.cost - 0.5 * log_det))


def _differ(one: Chain, other: Chain, sigma: FloatArray) -> bool:
    q = anywhere(one.n_joints)
    apart = (one.torque(q) - other.torque(q)) / sigma
    return bool(np.sqrt((apart ** 2).mean(axis=0)).max() > _SAME)
