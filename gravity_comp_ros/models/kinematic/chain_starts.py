"""
Where the chain's search starts, and how a bad end is noticed.

The cost has other minima than the right one. They show: their residual still holds something
that features of the dictionary explain, where the right one leaves noise, and less of it in the
directions that the fit itself took. So minima are sought from random axes, and from the best one
with an axis or two thrown anew (most wrong minima have one wrong axis), until nothing is left to
explain or the starts are used up. A start costs some tens of ms on 200 samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.kinematic.chain import aligned
from gravity_comp_ros.models.kinematic.chain_solver import (
    ChainProblem, Solution, solve, SolveOptions)
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.models.sparse.lasso import column_lengths, has_length
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np

# Samples that a start is tried on.
_FEW = 200
_ROUGH = SolveOptions(max_steps=60, tolerance=1e-4)
# A right minimum moves little when the weights change; a wrong one is not worth the walk.
_NEAR = SolveOptions(max_steps=6, tolerance=1e-4)
# Starts from random axes before the best one is varied.
_RANDOM = 4
# The best minimum is taken once so many more starts have ended in it, within this share of its
# cost: a residual that friction or an unmodelled effect leaves is never clean.
_HITS, _SAME_MINIMUM = 3, 0.02
# Draws of noise that a residual is compared with, and samples that it is compared on.
_DRAWS, _ENOUGH = 16, 500
# Right minima leave -3 to -5 (noise that lost what was fitted), wrong ones 1 to 30.
LIMIT = 0.0
_REWEIGHTED = 2
# Neighbouring residuals of white noise are correlated by no more, in standard deviations.
_WHITE = 4.0


@dataclass(frozen=True)
class SearchOptions:
    """
    How long to search: at most `starts`, drawn from `seed`.

    Where the end is unsure, `rivals` more starts look for other chains (`chain_rivals`); 0 for a
    fit whose uncertainty nobody asks for.

    :raises OptionError: if there are no starts, or fewer than no rivals.
    """

    starts: int = 40
    seed: int = 0
    rivals: int = 16

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise OptionError(f'chain: {self.starts} starts; there must be at least 1')
        if self.rivals < 0:
            raise OptionError(f'chain: {self.rivals} starts for rivals; there must be 0 or more')


@dataclass(frozen=True)
class Found:
    """A minimum of the full problem, the starts it took, and whether it leaves noise alone."""

    solution: Solution
    starts: int
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
    hits = 0
    for count in range(1, options.starts + 1):
        axes = start if count == 1 and start is not None else next_axes(
            rng, problem.n_joints, count, best)
        tried = solve(few, axes, options=_ROUGH)
        if best is not None and tried.cost >= (1.0 - 1e-3) * best.cost:
            hits += tried.cost <= (1.0 + _SAME_MINIMUM) * best.cost
            if hits >= _HITS:
                break
            continue
        # A start that ends a little lower has found the same minimum again.
        hits = hits + 1 if best is not None and tried.cost >= (
            1.0 - _SAME_MINIMUM) * best.cost else 0
        best = tried
        if not _is_clean(few, tried):
            continue
        result = _on_all(problem, best, count)
        if result.clean:
            return result
    assert best is not None
    return _on_all(problem, best, count)


def structure(problem: ChainProblem, solution: Solution) -> float:
    """
    Return how much the dictionary explains of a residual, against what it explains of noise.

    That is the logarithm of sum_k (A_k . r)^2 / |A_k|^2 over all 3^N features of an energy, less
    its mean over draws of white noise, in their standard deviations. Each joint counts in
    units of its own residual.
    """
    problem = thinned(problem, _ENOUGH)
    residual = problem.residual(solution.chain)
    spread = np.maximum(np.sqrt((residual ** 2).mean(axis=0)), floor(problem.tau))
    design = EnergyDesign(problem.q, np.broadcast_to(1.0 / spread, residual.shape))
    lengths = column_lengths(design)
    kept = has_length(lengths)

    def explained(unit: FloatArray) -> float:
        score = design.correlate(unit.T.ravel())[kept] / lengths[kept]
        return float(np.log(max(float(score @ score), 1e-300)))

    rng = np.random.default_rng(0)
    noise = np.array([explained(rng.normal(size=residual.shape)) for _ in range(_DRAWS)])
    return float((explained(residual / spread) - noise.mean()) / noise.std(ddof=1))


def thinned(problem: ChainProblem, count: int = _FEW) -> ChainProblem:
    """Return the problem of evenly picked samples, at most `count`."""
    if len(problem.q) <= count:
        return problem
    return problem.select(np.linspace(0, len(problem.q) - 1, count).astype(int))


def _on_all(problem: ChainProblem, rough: Solution, count: int) -> Found:
    solution = solve(problem, rough.chain.axes)
    return Found(solution, count, _is_clean(problem, solution))


def _is_clean(problem: ChainProblem, solution: Solution) -> bool:
    """
    Return whether a solution leaves noise alone, once each joint has the weight of its own.

    Under equal weights the errors that a noisy joint forces on a quiet one look like structure.
    """
    for count in range(_REWEIGHTED + 1):
        if count:
            residual = problem.residual(solution.chain)
            spread = np.maximum(np.sqrt((residual ** 2).mean(axis=0)), floor(problem.tau))
            problem = problem.with_weights(np.broadcast_to(1.0 / spread, residual.shape))
            solution = solve(problem, solution.chain.axes, options=_NEAR)
        # The features cost far more than neighbours do.
        if is_white(problem, solution) and structure(problem, solution) <= LIMIT:
            return True
    return False


def is_white(problem: ChainProblem, solution: Solution) -> bool:
    """Return whether no joint's residual is like that of the sample before it."""
    residual = problem.residual(solution.chain)
    power = np.maximum((residual ** 2).sum(axis=0), len(residual) * floor(problem.tau) ** 2)
    likeness = (residual[1:] * residual[:-1]).sum(axis=0) / power
    return bool(likeness.max(initial=0.0) < _WHITE / np.sqrt(len(residual)))


def next_axes(rng: np.random.Generator, n: int, count: int, best: Solution | None
              ) -> FloatArray:
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
