"""
Robust fit of the sparse formulations `potential` and `per_joint` jointly with linear terms.

ADMM solves every L1 problem on columns from which the linear terms are projected out (Yu 2022,
Eqs. 8-14; `models.sparse.projected`). Gravity on its support and all linear terms are then fitted
together, insignificant nuisance terms are dropped, and the support is selected again.
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
    The torques of all joints, the energy of `potential`, and the linear terms.

    `coefficients` (K,) are those of `regression.linear_terms()`, `covariance` (K, K) theirs.
    """

    torques: tuple[Expansion, ...]
    energy: Expansion | None
    fits: list[SparseFit]
    regression: Regression
    coefficients: FloatArray
    covariance: FloatArray

    def gravity(self, q: FloatArray) -> FloatArray:
        """Return the gravity torque (M, N) in N·m of poses q (M, N)."""
        return torque_of(self.torques, q)

    def residual(self) -> FloatArray:
        """Return the residual (m, N) in N·m of gravity and linear terms."""
        return self.regression.residual(self.gravity(self.regression.samples.q),
                                        self.coefficients)


def estimate_sparse(regression: Regression, formulation: str, options: SparseOptions,
                    old: tuple[Expansion, ...] | Expansion | None = None,
                    final_terms: bool = False) -> SparseEstimate:
    """
    Fit `potential` or `per_joint`.

    :param old: the energy, or the torques, of an old model to start from.
    :param final_terms: whether the nuisance terms and robust weights stay as they are.
    :raises FitError: if there are no samples.
    """
    if formulation == 'per_joint':
        # Its dictionary has the constant, so an offset is a feature already (Yu 2022, Eq. 5).
        regression = regression.with_terms([
            k for k, column in enumerate(regression.nuisance.columns) if column.kind != OFFSET])
    first = _solve(regression, formulation, options, old)
    if final_terms:
        return first
    k = regression.n_effects
    kept = significant(first.coefficients[k:], first.covariance[k:, k:])
    refined = regression.with_terms(kept).reweighted(first.residual())
    if len(kept) == len(regression.nuisance.columns) and (refined.robust_weights == 1.0).all():
        return first
    start = first.energy if formulation == 'potential' else first.torques
    return _solve(refined, formulation, options, start)


def _solve(regression: Regression, formulation: str, options: SparseOptions,
           old: tuple[Expansion, ...] | Expansion | None) -> SparseEstimate:
    samples, terms = regression.samples, regression.linear_terms()
    n, energy = samples.n_joints, None
    if formulation == 'potential':
        start = old if isinstance(old, Expansion) else None
        energy, fits = fit_potential(samples, options, start, terms.columns, terms.trust,
                                     terms.spread)
        torques = tuple(energy.gradient(n, joint) for joint in range(n))
        gravity = energy_columns(energy, samples.q)
    else:
        torques, fits = fit_per_joint(samples, options,
                                      old if isinstance(old, tuple) else None, terms.columns,
                                      terms.trust, terms.spread)
        gravity = _torque_columns(samples.q, torques)
    sigma = _sigma(fits, samples.q, torques)
    weights = (1.0 if terms.trust is None else np.sqrt(terms.trust)) / sigma
    return SparseEstimate(torques, energy, fits, regression,
                          *_coefficients(regression, gravity, weights, torques))


def energy_columns(energy: Expansion, q: FloatArray) -> FloatArray:
    """Return d torque / d weight (P, N, m) of an energy at poses q (m, N)."""
    columns = EnergyDesign(q, np.ones(q.shape)).columns(energy.indices)
    return columns.T.reshape(-1, *q.T.shape)


def _torque_columns(q: FloatArray, torques: tuple[Expansion, ...]) -> FloatArray:
    """Return the columns (P, N, m) of the terms of each joint's own torque."""
    parts = []
    for joint, torque in enumerate(torques):
        part = np.zeros((len(torque.indices), len(torques), len(q)))
        part[:, joint] = dictionary.columns(q, torque.indices).T
        parts.append(part)
    return np.concatenate(parts)


def _sigma(fits: list[SparseFit], q: FloatArray, torques: tuple[Expansion, ...]) -> FloatArray:
    """Return the noise std (m, N) in N·m, inflated for autocorrelation."""
    absolute = np.concatenate([fit.noise.absolute for fit in fits])
    relative = np.concatenate([fit.noise.relative for fit in fits])
    inflation = np.concatenate([np.full(len(fit.noise.absolute), fit.inflation) for fit in fits])
    return noise.NoiseModel(absolute, relative).sigma(torque_of(torques, q)) * np.sqrt(inflation)


def _coefficients(regression: Regression, gravity: FloatArray, weights: FloatArray,
                  torques: tuple[Expansion, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of linear terms, and their covariance with gravity free as well."""
    terms = regression.linear_terms()
    columns = terms.columns
    if columns is None:
        return np.zeros(0), np.zeros((0, 0))
    samples = regression.samples
    residual = samples.tau - torque_of(torques, samples.q)
    rows = (columns * weights.T).reshape(-1, samples.tau.size)
    prior_std = scaled_spread(terms.spread, columns.reshape(len(columns), -1).T, rows.T)
    assert prior_std is not None
    coefficients = nuisance_coefficients(rows.T, (weights * residual).T.ravel(), prior_std)
    every = np.concatenate([(gravity * weights.T).reshape(-1, samples.tau.size), rows])
    precision = every @ every.T
    precision[len(gravity):, len(gravity):] += np.diag(prior_std ** -2)
    covariance = scaled_inverse(precision)[len(gravity):, len(gravity):]
    return np.asarray(coefficients), np.asarray(covariance)


def scaled_inverse(information: FloatArray) -> FloatArray:
    """Return the pseudo-inverse (K, K) of an information matrix, scaled to a unit diagonal."""
    lengths = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scale = np.outer(lengths, lengths)
    return np.asarray(np.linalg.pinv(information / scale, rcond=1e-10, hermitian=True) / scale)
