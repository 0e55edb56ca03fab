"""
How many samples count as one, chosen on data that the fit has not seen.

Where the residual is white, every sample counts. Where it is correlated (friction, hysteresis,
drift), the growing support fits it as though it were gravity: right on the data, wild on the
next run. So inflations up to the residual's correlation time are tried on held-out runs, or on
contiguous blocks where there are too few runs, and the largest whose error is within one
standard error of the least is taken: the smallest support that is as good.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.folds import folds
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.sparse.sparse_problem import (
    grow, prune, Settled, SparseOptions, SparseProblem)
import numpy as np

_LADDER = (1.0, 3.0, 10.0, 30.0, 100.0)
# Shorter correlation times than this are what chance makes of white noise.
_WHITE = 2.0


@dataclass(frozen=True)
class Choice:
    """The inflation taken; the tried ones with their held-out errors, in units of the noise."""

    inflation: float
    correlation_time: float
    tried: tuple[float, ...]
    errors: tuple[float, ...]


def choose_inflation(problem: SparseProblem, grown: Settled,
                     options: SparseOptions) -> Choice:
    """Return the inflation for a grown support (module docstring)."""
    residual = grown.residual(problem)
    time = correlation_time(problem, grown)
    tried = [k for k in _LADDER if k == 1.0 or k < 2.0 * time]
    if time < _WHITE or len(tried) < 2:
        return Choice(1.0, time, (1.0,), ())
    scale = np.sqrt((residual ** 2).mean(axis=0)) + noise.floor(problem.tau)
    errors = np.array([_held_out(problem, test, tried, options, scale)
                       for test in folds(problem.runs)])
    mean = errors.mean(axis=0)
    best = int(np.argmin(mean))
    extra = errors - errors[:, [best]]
    allowed = extra.mean(axis=0) <= extra.std(axis=0, ddof=1) / np.sqrt(len(errors))
    taken = max(k for k, fine in zip(tried, allowed) if fine or k == tried[best])
    return Choice(taken, time, tuple(tried), tuple(mean.tolist()))


def correlation_time(problem: SparseProblem, settled: Settled) -> float:
    """Return the median over the torques of how many samples of the residual count as one."""
    return float(np.median([noise.correlation_time(column, problem.runs)
                            for column in settled.residual(problem).T]))


def _held_out(problem: SparseProblem, test: BoolArray, tried: list[float],
              options: SparseOptions, scale: FloatArray) -> FloatArray:
    """Return the mean square error on `test`, fitted without it, for each inflation."""
    train, unseen = problem.select(~test), problem.select(test)
    settled = grow(train, options)
    errors = []
    for inflation in tried:
        settled = prune(train, settled, inflation)
        predicted = (unseen.predict(settled.refit.indices, settled.refit.x)
                     + unseen.nuisance_torque(settled.nuisance))
        errors.append(float((((unseen.tau - predicted) / scale) ** 2).mean()))
    return np.array(errors)
