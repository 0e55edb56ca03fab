"""
Standard deviations of coefficients where samples are autocorrelated.

The sandwich estimate over blocks of time (Liang and Zeger 1986),

    cov = A^-1 (sum_b s_b s_b.T) A^-1,    s_b = sum of x r over the samples of block b,

A the information matrix. It is used where it is larger than what independent samples would give.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.estimation.chain_estimate import ChainEstimate
from gravity_comp_ros.estimation.fit import Estimate
from gravity_comp_ros.evaluation.blocks import cut
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np
from scipy import special


def clustered_std(estimate: Estimate) -> tuple[FloatArray, float]:
    """
    Return the standard deviations (K,) of the effects' coefficients, and the 97.5 % quantile.

    The quantile is that of Student's t with one degree of freedom less than there are blocks.
    """
    plain = np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
    regression, found = estimate.regression, estimate.choice.estimate
    residual = found.residual()
    try:
        blocks = cut(regression.samples, residual)
    except DataError:
        return plain, 1.96
    weights = regression.row_weights(residual)
    beside = regression.beside().columns
    assert beside is not None
    every = np.concatenate([beside, _gravity_columns(estimate)])
    rows = every * weights.T
    flat = rows.reshape(len(rows), -1)
    scores = blocks.sums((rows * (weights * residual).T).sum(axis=1).T)
    information = flat @ flat.T
    lengths = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(lengths, lengths), rcond=1e-10,
                             hermitian=True) / np.outer(lengths, lengths)
    spread = inverse @ (scores.T @ scores) @ inverse * blocks.count / max(blocks.count - 1, 1)
    k = len(plain)
    robust = np.sqrt(np.maximum(np.diag(spread)[:k], 0.0))
    return np.maximum(plain, robust), float(special.stdtrit(max(blocks.count - 1, 2), 0.975))


def _gravity_columns(estimate: Estimate) -> FloatArray:
    """Return d torque / d parameter of gravity, (P, N, m)."""
    found, samples = estimate.choice.estimate, estimate.regression.samples
    n, m = samples.n_joints, samples.n_samples
    if isinstance(found, ChainEstimate):
        free = np.diag(found.fit.covariance) > 0.0
        return found.chain.jacobian(samples.q)[free]
    if found.energy is None:
        return np.zeros((0, n, m))
    columns = EnergyDesign(samples.q, np.ones(samples.q.shape)).columns(found.energy.indices)
    return columns.T.reshape(-1, n, m)
