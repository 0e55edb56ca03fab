"""
Search for the gravity of a serial arm with unknown axes, as the start of a regression.

The likelihood has several maxima. Most of the wrong ones have one wrong axis. The search starts
from random axes, and from the best axes with one or two of them replaced, until it has reached
the best maximum several times or the starts are used up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray, spread_over
from gravity_comp_ros.models.kinematic.arm_solver import ArmProblem, ArmSolver, ArmState
from gravity_comp_ros.models.kinematic.chain import aligned
import numpy as np

# Number of samples for a coarse solution.
_COARSE_SAMPLES = 200
# Number of starts from random axes before the best axes are varied.
_RANDOM = 4
# Maxima within this many nats per effort are the same.
_SAME = 0.01


def search(problem: ArmProblem, starts: int, seed: int = 0, hits: int = 4) -> ArmState:
    """
    Return the best solution from at most a number of starts, drawn from `seed`.

    :param hits: the number of further starts that must reach the best maximum.
    """
    few = ArmSolver.of_axes(_coarse(problem))
    rng, reached = np.random.default_rng(seed), 0
    same = _SAME * few.problem.tau.size
    best: ArmState | None = None
    for count in range(1, starts + 1):
        tried = few.run(_next_axes(rng, problem.q.shape[1], count, best))
        if best is not None and tried.cost > best.cost - same:
            # A slightly lower cost is the same maximum again.
            reached += tried.cost < best.cost + same
            if reached >= hits:
                break
            continue
        best, reached = tried, 0
    assert best is not None
    return ArmSolver.of_axes(problem).run(best.chain.axes)


def _next_axes(rng: np.random.Generator, n: int, count: int, best: ArmState | None) -> FloatArray:
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


def _coarse(problem: ArmProblem) -> ArmProblem:
    """
    Return the problem of at most `_COARSE_SAMPLES` evenly picked samples, with one noise.

    Far from a solution a joint with little effort would be fitted at the cost of all others.
    """
    few = problem.select(spread_over(len(problem.q), _COARSE_SAMPLES))
    return replace(few, has_one_noise=True)
