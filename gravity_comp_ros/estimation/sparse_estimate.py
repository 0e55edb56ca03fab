"""
The sparse formulations, `potential` and `per_joint`, beside friction, offset and outliers.

Every L1 problem is solved by ADMM on columns from which the nuisance columns are projected out
(Yu 2022, Eqs. 8-14; `models.sparse.projected`). Then gravity and everything beside it are fitted
together on the support, nuisance terms that are not told from 0 are dropped, and the support is
found anew without them.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.nuisance_columns import significant
from gravity_comp_ros.estimation.regression import Regression
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.nuisance import OFFSET
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.expansion import Expansion, torque_of
from gravity_comp_ros.models.sparse.per_joint import fit_per_joint
from gravity_comp_ros.models.sparse.potential import fit_potential
from gravity_comp_ros.models.sparse.projected import nuisance_coefficients, scaled_spread
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.sparse.sparse_problem import SparseFit, SparseOptions
import numpy as np


@dataclass(frozen=True, eq=False)
class SparseEstimate:
    """
    The torques of all joints, the energy where there is one, and what was fitted beside them.

    `beside` (K,) are the coefficients of `regression.beside()`, `covariance` (K, K) theirs.
    """

    torques: tuple[Expansion, ...]
    energy: Expansion | None
    fits: list[SparseFit]
    regression: Regression
    beside: FloatArray
    covariance: FloatArray

    def gravity(self, q: FloatArray) -> FloatArray:
        """Return the gravity torque (M, N) in N·m of poses q (M, N)."""
        return torque_of(self.torques, q)

    def residual(self) -> FloatArray:
        """Return what gravity and everything beside it leave, (m, N) in N·m."""
        return self.regression.residual(self.gravity(self.regression.samples.q), self.beside)


def estimate_sparse(regression: Regression, formulation: str, options: SparseOptions,
                    old: tuple[Expansion, ...] | Expansion | None = None,
                    settled: bool = False) -> SparseEstimate:
    """
    Fit `potential` or `per_joint`.

    :param old: the energy, or the torques, of an old model to start from.
    :param settled: the regression's nuisance terms and trust are those of a better fit already.
    :raises FitError: if there are no samples.
    """
    if formulation == 'per_joint':
        # Its dictionary has the constant, so an offset is a feature already (Yu 2022, Eq. 5).
        regression = regression.with_terms([
            k for k, column in enumerate(regression.nuisance.columns) if column.kind != OFFSET])
    found = _solve(regression, formulation, options, old)
    if settled:
        return found
    k = regression.n_effects
    kept = significant(found.beside[k:], found.covariance[k:, k:])
    refined = regression.with_terms(kept).trusting(found.residual())
    if len(kept) == len(regression.nuisance.columns) and (refined.trust == 1.0).all():
        return found
    again = found.energy if formulation == 'potential' else found.torques
    return _solve(refined, formulation, options, again)


def _solve(regression: Regression, formulation: str, options: SparseOptions,
           old: tuple[Expansion, ...] | Expansion | None) -> SparseEstimate:
    samples, beside = regression.samples, regression.beside()
    n, energy = samples.n_joints, None
    if formulation == 'potential':
        start = old if isinstance(old, Expansion) else None
        energy, fits = fit_potential(samples, options, start, beside.columns, beside.trust,
                                     beside.spread)
        torques = tuple(energy.gradient(n, joint) for joint in range(n))
        columns = EnergyDesign(samples.q, np.ones(samples.q.shape)).columns(energy.indices)
        gravity = columns.T.reshape(-1, n, samples.n_samples)
    else:
        torques, fits = fit_per_joint(samples, options,
                                      old if isinstance(old, tuple) else None, beside.columns,
                                      beside.trust, beside.spread)
        gravity = _torque_columns(samples.q, torques)
    sigma = _sigma(fits, samples.q, torques)
    weights = (1.0 if beside.trust is None else np.sqrt(beside.trust)) / sigma
    return SparseEstimate(torques, energy, fits, regression,
                          *_coefficients(regression, gravity, weights, torques))


def _torque_columns(q: FloatArray, torques: tuple[Expansion, ...]) -> FloatArray:
    """Return the columns (P, N, m) of the terms of each joint's own torque."""
    parts = []
    for joint, torque in enumerate(torques):
        part = np.zeros((len(torque.indices), len(torques), len(q)))
        part[:, joint] = dictionary.columns(q, torque.indices).T
        parts.append(part)
    return np.concatenate(parts)


def _sigma(fits: list[SparseFit], q: FloatArray, torques: tuple[Expansion, ...]) -> FloatArray:
    """Return the standard deviation (m, N) of the noise, correlation in time counted in."""
    predicted = torque_of(torques, q)
    absolute = np.concatenate([fit.noise.absolute for fit in fits])
    relative = np.concatenate([fit.noise.relative for fit in fits])
    inflation = np.concatenate([np.full(len(fit.noise.absolute), fit.inflation) for fit in fits])
    return noise.NoiseModel(absolute, relative).sigma(predicted) * np.sqrt(inflation)


def _coefficients(regression: Regression, gravity: FloatArray, weights: FloatArray,
                  torques: tuple[Expansion, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients beside gravity, and their covariance with gravity free as well."""
    beside = regression.beside()
    columns = beside.columns
    if columns is None:
        return np.zeros(0), np.zeros((0, 0))
    samples = regression.samples
    left = samples.tau - torque_of(torques, samples.q)
    rows = (columns * weights.T).reshape(-1, samples.tau.size)
    spread = scaled_spread(beside.spread, columns.reshape(len(columns), -1).T, rows.T)
    assert spread is not None
    found = nuisance_coefficients(rows.T, (weights * left).T.ravel(), spread)
    every = np.concatenate([(gravity * weights.T).reshape(-1, samples.tau.size), rows])
    precision = every @ every.T
    precision[len(gravity):, len(gravity):] += np.diag(spread ** -2)
    lengths = np.sqrt(np.maximum(np.diag(precision), 1e-300))
    inverse = np.linalg.pinv(precision / np.outer(lengths, lengths), rcond=1e-10, hermitian=True)
    covariance = inverse / np.outer(lengths, lengths)
    return np.asarray(found), np.asarray(covariance[len(gravity):, len(gravity):])
