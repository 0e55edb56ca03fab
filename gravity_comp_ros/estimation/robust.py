"""
How far each sample is trusted: a brake that grips, a push, a spike must not become gravity.

Weights of squared residuals after Huber (1964), with a redescending end (Hampel 1974):

    w(z) = 1 for |z| <= 4,    4 / |z| up to 8,    0 beyond,    z = residual / sigma,

sigma from the median absolute residual of the joint, so that outliers do not widen it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
import numpy as np

_FULL, _NONE = 4.0, 8.0
# A normal distribution has its median absolute value here.
_MEDIAN = 0.6745
# More outliers than this share are no outliers: the model is wrong there, not the samples.
_MOST = 0.25


# Rounds of the regression whose residual shows outliers before anything else is fitted.
_ROUNDS = 4


@dataclass(frozen=True)
class SetAside:
    """Samples of one joint that were set aside: how many, and the first and last time in s."""

    n: int
    first: float
    last: float
    label: str


def trust(residual: FloatArray, least: float) -> FloatArray:
    """
    Return the weights (M, N) of squared residuals (M, N) in N·m.

    :param least: the smallest standard deviation that is believed, N·m.
    """
    sigma = np.maximum(np.median(np.abs(residual), axis=0) / _MEDIAN, least)
    z = np.abs(residual) / sigma
    weights = np.where(z <= _FULL, 1.0, np.where(z <= _NONE, _FULL / np.maximum(z, 1e-300), 0.0))
    weights[:, (z > _FULL).mean(axis=0) > _MOST] = 1.0
    return np.asarray(weights)


def trust_beside(residual: FloatArray, columns: FloatArray, least: float) -> FloatArray:
    """
    Return the weights (M, N) of a residual that linear terms explain but for outliers.

    The terms are a ridge regression, reweighted until outliers stand out.

    :param residual: (M, N) in N·m, before the terms are fitted.
    :param columns: torque per unit of each term (K, N, M); in N·m for a coefficient in N·m.
    :param least: the smallest standard deviation that is believed, N·m.
    """
    weights = np.ones(residual.shape)
    rows = columns.reshape(len(columns), -1)
    target, size = residual.T.ravel(), max(float(np.abs(residual).max()), least)
    for _ in range(_ROUNDS):
        left = target - _ridge(rows, target, weights.T.ravel(), least / size) @ rows
        weights, last = trust(left.reshape(residual.shape[::-1]).T, least), weights
        if np.array_equal(weights, last):
            break
    return weights


def _ridge(rows: FloatArray, target: FloatArray, weights: FloatArray, part: float) -> FloatArray:
    """Return coefficients (K,); the prior counts as `part` of what the noise does."""
    gram = (rows * weights) @ rows.T + part ** 2 * np.eye(len(rows))
    return np.asarray(np.linalg.solve(gram, rows @ (weights * target)))


def set_aside(samples: JointSamples, weights: FloatArray) -> Mapping[str, SetAside]:
    """Return what was set aside of each joint that lost samples: those with no weight."""
    found = {}
    for n, name in enumerate(samples.names):
        gone: BoolArray = weights[:, n] == 0.0
        if gone.any():
            where = np.flatnonzero(gone)
            found[name] = SetAside(int(gone.sum()), float(samples.t[where[0]]),
                                   float(samples.t[where[-1]]),
                                   samples.run_labels[samples.runs[where[0]]])
    return found
