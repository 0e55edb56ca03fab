"""
Where the chain's search starts, and how a bad end is noticed.

The cost has other minima than the right one. They show: their residual still holds something
that some feature of the dictionary explains, where the right one leaves noise. So minima are
sought from random axes, and from the best one with an axis or two thrown anew (most wrong minima
have one wrong axis), until nothing is left to explain or the starts are used up. A start costs
some tens of ms on 200 samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.gravity.chain import aligned
from gravity_comp_ros.gravity.chain_solve import ChainProblem, Solution, solve, SolveOptions
from gravity_comp_ros.gravity.design import EnergyDesign
from gravity_comp_ros.gravity.lasso import column_lengths, has_length
from gravity_comp_ros.samples import FloatArray
import numpy as np

# Samples that a start is tried on.
_FEW = 200
_ROUGH = SolveOptions(max_steps=60, tolerance=1e-4)
# Starts from random axes before the best one is varied.
_RANDOM = 4
# Above the sqrt(2 ln K) that the largest of K standard normal numbers comes to.
_MARGIN = 2.0


@dataclass(frozen=True)
class SearchOptions:
    """
    How long to search: at most `starts`, drawn from `seed`.

    :raises OptionError: if there are no starts.
    """

    starts: int = 40
    seed: int = 0

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise OptionError(f'chain: {self.starts} starts; there must be at least 1')


@dataclass(frozen=True)
class Found:
    """A minimum of the full problem, the starts it took, and what its residual still holds."""

    solution: Solution
    starts: int
    structure: float
    clean: bool


def search(problem: ChainProblem, options: SearchOptions = SearchOptions(),
           start: FloatArray | None = None) -> Found:
    """
    Return the best minimum found.

    :param start: axes (N, 3, 3) that are tried before any others.
    """
    few = thinned(problem)
    rng = np.random.default_rng(options.seed)
    best: Solution | None = None
    result: Found | None = None
    for count in range(1, options.starts + 1):
        axes = start if count == 1 and start is not None else _next(rng, problem.n_joints,
                                                                    count, best)
        tried = solve(few, axes, options=_ROUGH)
        if best is not None and tried.cost >= (1.0 - 1e-3) * best.cost:
            continue
        best = tried
        if structure(few, tried) > limit(problem.n_joints):
            continue
        result = _on_all(problem, best, count)
        if result.clean:
            return result
    assert best is not None
    return _on_all(problem, best, options.starts)


def structure(problem: ChainProblem, solution: Solution) -> float:
    """
    Return how much of a residual some feature explains, in standard deviations.

    The largest |A_k . r| / |A_k| over all 3^N features of an energy, in units of the residual's
    own standard deviation, joint by joint.
    """
    residual = problem.tau - solution.chain.torque(problem.q)
    spread = np.sqrt((residual ** 2).mean(axis=0))
    spread = np.maximum(spread, 1e-9 * max(float(spread.max()), 1e-300))
    weights = np.broadcast_to(1.0 / spread, residual.shape)
    design = EnergyDesign(problem.q, weights)
    lengths = column_lengths(design)
    kept = has_length(lengths)
    score = np.abs(design.correlate((weights * residual).T.ravel())[kept]) / lengths[kept]
    return float(score.max(initial=0.0))


def limit(n_joints: int) -> float:
    """Return the `structure` that noise stays under."""
    return float(np.sqrt(2.0 * n_joints * np.log(3.0)) + _MARGIN)


def thinned(problem: ChainProblem, count: int = _FEW) -> ChainProblem:
    """Return the problem of evenly picked samples, at most `count`."""
    if len(problem.q) <= count:
        return problem
    keep = np.linspace(0, len(problem.q) - 1, count).astype(int)
    return ChainProblem(problem.q[keep], problem.tau[keep], problem.weights[keep])


def _on_all(problem: ChainProblem, rough: Solution, count: int) -> Found:
    solution = solve(problem, rough.chain.axes)
    left = structure(problem, solution)
    return Found(solution, count, left, left <= limit(problem.n_joints))


def _next(rng: np.random.Generator, n: int, count: int, best: Solution | None) -> FloatArray:
    """Return random axes, or the best ones with one or two of them thrown anew."""
    thrown = _directions(rng, n)
    if best is None or count <= _RANDOM or rng.random() < 0.25:
        return np.stack(list(thrown))
    axes = best.chain.axes.copy()
    for j in rng.choice(n, size=min(n, int(rng.integers(1, 3))), replace=False):
        axes[j] = axes[j] @ next(thrown)
    return axes


def _directions(rng: np.random.Generator, n: int) -> Iterator[FloatArray]:
    """Yield n rotations that turn z anywhere."""
    for direction in rng.normal(size=(n, 3)):
        yield aligned(direction / np.linalg.norm(direction))
