"""
Robust weights of samples, against outliers by brake engagement, contact and torque spikes.

Weights of squared residuals after Huber (1964), with a redescending end (Hampel 1974):

    w(z) = 1 for |z| <= 4,    4 / |z| up to 8,    0 beyond,    z = residual / sigma,

with sigma from the median absolute residual of the joint, which outliers hardly affect.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.models import noise
import numpy as np

# Maximum |z| of full weight, and of any weight.
_MAX_FULL, _MAX_WEIGHTED = 4.0, 8.0
# Median absolute value of a standard normal distribution.
_NORMAL_MEDIAN = 0.6745
# Maximum share of outliers; more of them indicate a model error, and all weights stay 1.
_MAX_OUTLIERS = 0.25
# Maximum rounds of the reweighted regression.
_MAX_ROUNDS = 4


@dataclass(frozen=True)
class Outliers:
    """Outliers of one joint: the number of samples, first and last time in s, and their runs."""

    n: int
    first: float
    last: float
    label: str
    last_label: str

    def __str__(self) -> str:
        first = '' if self.label == self.last_label else f' s of {self.label}'
        return f'from {self.first:.1f}{first} to {self.last:.1f} s of {self.last_label}'


def huber_weights(residual: FloatArray, min_sigma: float) -> FloatArray:
    """
    Return the weights (M, N) of squared residuals (M, N) in N·m.

    :param min_sigma: the minimum standard deviation, N·m.
    """
    sigma = np.maximum(np.median(np.abs(residual), axis=0) / _NORMAL_MEDIAN, min_sigma)
    z = np.abs(residual) / sigma
    weights = np.where(z <= _MAX_FULL, 1.0,
                       np.where(z <= _MAX_WEIGHTED, _MAX_FULL / np.maximum(z, 1e-300), 0.0))
    weights[:, (z > _MAX_FULL).mean(axis=0) > _MAX_OUTLIERS] = 1.0
    return np.asarray(weights)


def irls_weights(residual: FloatArray, columns: FloatArray, min_sigma: float) -> FloatArray:
    """
    Return the weights (M, N) of a residual that linear terms explain except for outliers.

    The terms are fitted by iteratively reweighted ridge regression.

    :param residual: (M, N) in N·m, before the terms are fitted.
    :param columns: torque per unit of each term (K, N, M); in N·m for a coefficient in N·m.
    :param min_sigma: the minimum standard deviation, N·m.
    """
    weights = np.ones(residual.shape)
    rows = columns.reshape(len(columns), -1)
    target, size = residual.T.ravel(), max(float(np.abs(residual).max()), min_sigma)
    for _ in range(_MAX_ROUNDS):
        coefficients = _ridge(rows, target, weights.T.ravel(), min_sigma / size)
        remaining = (target - coefficients @ rows).reshape(residual.shape[::-1]).T
        weights, last = huber_weights(remaining, min_sigma), weights
        if np.array_equal(weights, last):
            break
    return weights


def _ridge(rows: FloatArray, target: FloatArray, weights: FloatArray, ratio: float) -> FloatArray:
    """Return coefficients (K,) for a ratio of noise std to prior std."""
    gram = (rows * weights) @ rows.T + ratio ** 2 * np.eye(len(rows))
    return np.asarray(np.linalg.solve(gram, rows @ (weights * target)))


def outliers(rows: JointSamples, count: IntArray, residual: FloatArray) -> Mapping[str, Outliers]:
    """
    Return the rows whose residual is beyond any weight, by name of each joint that has any.

    :param rows: means over short times, R of them.
    :param count: number of samples of each row (R,).
    :param residual: of the rows, (R, N) in N·m.
    """
    weights, by_joint = huber_weights(residual, noise.floor(rows.tau)), {}
    for n, name in enumerate(rows.names):
        places = np.flatnonzero(weights[:, n] == 0.0)
        if places.size:
            first, last = (rows.run_labels[rows.runs[place]] for place in places[[0, -1]])
            by_joint[name] = Outliers(int(count[places].sum()), float(rows.t[places[0]]),
                                      float(rows.t[places[-1]]), first, last)
    return by_joint
