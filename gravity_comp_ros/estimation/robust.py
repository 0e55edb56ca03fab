"""Outliers of samples: brake engagement, contact and torque spikes (`noise.outlier_weights`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.models import noise
import numpy as np

# Rounds of the reweighted regression.
_ROUNDS = 4


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
    for _ in range(_ROUNDS):
        coefficients = _ridge(rows, target, weights.T.ravel(), min_sigma / size)
        remaining = (target - coefficients @ rows).reshape(residual.shape[::-1]).T
        weights = noise.outlier_weights(remaining, min_sigma)
    return weights


def _ridge(rows: FloatArray, target: FloatArray, weights: FloatArray, ratio: float) -> FloatArray:
    """Return coefficients (K,) for a ratio of noise std to prior std."""
    gram = (rows * weights) @ rows.T + ratio ** 2 * np.eye(len(rows))
    return np.asarray(np.linalg.solve(gram, rows @ (weights * target)))


def outliers(rows: JointSamples, count: IntArray, residual: FloatArray) -> Mapping[str, Outliers]:
    """
    Return the rows that are outliers, by name of each joint that has any.

    :param rows: means over short times, R of them.
    :param count: number of samples of each row (R,).
    :param residual: of the rows, (R, N) in N·m.
    """
    weights, by_joint = noise.outlier_weights(residual, noise.floor(rows.tau)), {}
    for n, name in enumerate(rows.names):
        places = np.flatnonzero(noise.is_outlier(weights[:, n]))
        if places.size:
            first, last = (rows.run_labels[rows.runs[place]] for place in places[[0, -1]])
            by_joint[name] = Outliers(int(count[places].sum()), float(rows.t[places[0]]),
                                      float(rows.t[places[-1]]), first, last)
    return by_joint
