"""
Selection of the variance inflation factor on held-out data.

A white residual requires no inflation. An autocorrelated residual (friction, hysteresis, drift) is
overfitted by the growing support, with large errors on the next run. So factors up to twice the
residual's correlation time are tried on held-out runs, or on contiguous blocks if there are too
few runs. The largest factor whose error is within one standard error of the lowest is selected,
which yields the smallest support of that accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.folds import folds
from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.sparse.sparse_problem import (
    grow, prune, SparseOptions, SparseProblem, SupportFit)
import numpy as np

_FACTORS = (1.0, 3.0, 10.0, 30.0, 100.0)


@dataclass(frozen=True)
class Choice:
    """The selected factor; the tried ones with their held-out errors, in units of the noise."""

    inflation: float
    correlation_time: float
    tried: tuple[float, ...]
    errors: tuple[float, ...]


def choose_inflation(problem: SparseProblem, grown: SupportFit,
                     options: SparseOptions) -> Choice:
    """Return the variance inflation factor for a grown support."""
    residual = grown.residual(problem)
    time = correlation_time(problem, grown)
    tried = [k for k in _FACTORS if k == 1.0 or k < 2.0 * time]
    if time < noise.WHITE or len(tried) < 2:
        return Choice(1.0, time, (1.0,), ())
    scale = np.sqrt((residual ** 2).mean(axis=0)) + noise.floor(problem.tau)
    errors = np.array([_held_out(problem, test, tried, options, scale)
                       for test in folds(problem.runs)])
    mean = errors.mean(axis=0)
    best = int(np.argmin(mean))
    excess = errors - errors[:, [best]]
    allowed = excess.mean(axis=0) <= excess.std(axis=0, ddof=1) / np.sqrt(len(errors))
    selected = max(k for k, is_allowed in zip(tried, allowed) if is_allowed or k == tried[best])
    return Choice(selected, time, tuple(tried), tuple(mean.tolist()))


def correlation_time(problem: SparseProblem, fit: SupportFit) -> float:
    """Return the median over the torques of the residual's correlation time, in samples."""
    return float(np.median(noise.correlation_times(fit.residual(problem), problem.runs)))


def _held_out(problem: SparseProblem, test: BoolArray, tried: list[float],
              options: SparseOptions, scale: FloatArray) -> FloatArray:
    """Return the mean square error on the held-out mask `test`, for each factor."""
    train, held_out = problem.select(~test), problem.select(test)
    fit = grow(train, options)
    errors = []
    for inflation in tried:
        fit = prune(train, fit, inflation)
        predicted = held_out.predict(fit.refit.indices, fit.refit.x)
        errors.append(float((((held_out.tau - predicted) / scale) ** 2).mean()))
    return np.array(errors)
