"""
Standard deviations of coefficients from autocorrelated samples.

The sandwich estimate over blocks of time (Liang and Zeger 1986),

    cov = A^-1 (sum_b s_b s_b.T) A^-1,    s_b = sum of x r over the samples of block b,

with the information matrix A. The larger of this and of the estimate for independent samples is
used.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.chain_estimate import ChainEstimate
from gravity_comp_ros.estimation.fit import Estimate
from gravity_comp_ros.estimation.sparse_estimate import energy_columns, scaled_inverse
from gravity_comp_ros.evaluation.blocks import cut
import numpy as np
from scipy import special


def clustered_std(estimate: Estimate) -> tuple[FloatArray, float]:
    """
    Return the standard deviations (K,) of the effects' coefficients, and the 97.5 % quantile.

    The quantile is that of Student's t with one degree of freedom less than there are blocks.
    """
    independent = np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
    regression = estimate.regression
    residual = estimate.choice.estimate.residual()
    try:
        blocks = cut(regression.samples, residual)
    except DataError:
        return independent, 1.96
    weights = regression.row_weights(residual)
    columns = regression.linear_terms().columns
    assert columns is not None
    rows = np.concatenate([columns, _gravity_columns(estimate)]) * weights.T
    flat = rows.reshape(len(rows), -1)
    scores = blocks.sums((rows * (weights * residual).T).sum(axis=1).T)
    inverse = scaled_inverse(flat @ flat.T)
    covariance = inverse @ (scores.T @ scores) @ inverse * blocks.count / max(blocks.count - 1, 1)
    clustered = np.sqrt(np.maximum(np.diag(covariance)[:len(independent)], 0.0))
    quantile = float(special.stdtrit(max(blocks.count - 1, 2), 0.975))
    return np.maximum(independent, clustered), quantile


def _gravity_columns(estimate: Estimate) -> FloatArray:
    """Return d torque / d parameter of gravity, (P, N, m)."""
    gravity, samples = estimate.choice.estimate, estimate.regression.samples
    if isinstance(gravity, ChainEstimate):
        free = np.diag(gravity.fit.covariance) > 0.0
        return gravity.chain.jacobian(samples.q)[free]
    if gravity.energy is None:
        return np.zeros((0, *samples.q.T.shape))
    return energy_columns(gravity.energy, samples.q)
