"""Projected designs: the same optimum as with explicit nuisance columns."""

from gravity_comp_ros.models.sparse.lasso import LassoProblem
from gravity_comp_ros.models.sparse.projected import (
    nuisance_coefficients, NuisanceBasis, orthonormal_basis, ProjectedDesign)
from gravity_comp_ros.models.sparse.regressor import EnergyDesign, TorqueDesign
from hypothesis import given, settings, strategies as st
import numpy as np


def problem(seed, kind, n=3, m=40):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (m, n))
    weights = rng.uniform(0.5, 2.0, (m, n if kind is EnergyDesign else 1))
    design = kind(q, weights)
    nuisance = rng.normal(size=(design.n_rows, 4))
    nuisance[:, 3] = 1e6 * nuisance[:, 0]    # dependent, and in other units
    return design, nuisance, rng


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10 ** 6), st.sampled_from([EnergyDesign, TorqueDesign]))
def test_products_are_those_of_the_projected_matrix(seed, kind):
    design, nuisance, rng = problem(seed, kind)
    features = np.arange(design.n_columns)
    q, _ = np.linalg.qr(nuisance[:, :3])
    dense = design.columns(features)
    dense = dense - q @ (q.T @ dense)
    projected = ProjectedDesign(design, NuisanceBasis.of(nuisance))
    r = rng.normal(size=design.n_rows)
    np.testing.assert_allclose(projected.columns(features), dense, atol=1e-9)
    np.testing.assert_allclose(projected.correlate(r), dense.T @ r, atol=1e-8)
    np.testing.assert_allclose(projected.squared_norms(), (dense ** 2).sum(axis=0), atol=1e-7)
    assert orthonormal_basis(nuisance).shape[1] == 3


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10 ** 6))
def test_l1_solutions_are_optimal_with_free_nuisance_coefficients(seed):
    design, nuisance, rng = problem(seed, EnergyDesign)
    x = np.zeros(design.n_columns)
    x[rng.choice(np.arange(1, design.n_columns), 3, replace=False)] = 5.0
    b = design.columns(np.arange(design.n_columns)) @ x + nuisance[:, :3] @ [9.0, -4.0, 2.0]
    b = b + 0.1 * rng.normal(size=len(b))
    projected = ProjectedDesign(design, NuisanceBasis.of(nuisance))
    lam = 2.0
    solution = LassoProblem(projected, projected.project(b),
                            np.ones(design.n_columns, dtype=bool)).solve(lam)
    assert solution.converged and solution.certificate.violation < 1e-6
    # The optimality conditions of the whole problem with explicit nuisance coefficients.
    columns = design.columns(np.arange(design.n_columns))
    weights = np.zeros(design.n_columns)
    weights[solution.indices] = solution.x
    c = np.linalg.lstsq(nuisance[:, :3], b - columns @ weights, rcond=None)[0]
    residual = b - columns @ weights - nuisance[:, :3] @ c
    lengths = np.sqrt(projected.squared_norms())
    score = columns.T @ residual
    kept = lengths > 1e-6 * lengths.max()
    assert (np.abs(score[kept]) <= lam * lengths[kept] * (1 + 1e-4) + 1e-6).all()
    np.testing.assert_allclose(score[solution.indices],
                               lam * lengths[solution.indices] * np.sign(solution.x), rtol=1e-3)
    np.testing.assert_allclose(nuisance[:, :3].T @ residual, 0.0, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10 ** 6))
def test_a_prior_is_equivalent_to_noise_with_its_covariance(seed):
    design, nuisance, rng = problem(seed, EnergyDesign)
    nuisance = nuisance[:, :3]
    spread = np.array([0.3, np.inf, 2.0])
    basis = NuisanceBasis.of(nuisance, spread)
    bounded = nuisance[:, [0, 2]] * spread[[0, 2]]
    free = np.linalg.qr(nuisance[:, [1]])[0]
    off = np.eye(len(nuisance)) - free @ free.T
    # Marginalised over both: the inverse covariance on the complement of the free column.
    whitened = np.linalg.inv(np.eye(len(nuisance)) + off @ bounded @ bounded.T @ off)
    expected = off @ whitened @ off
    dense = design.columns(np.arange(design.n_columns))
    projected = ProjectedDesign(design, basis)
    products = projected.columns(np.arange(design.n_columns))
    np.testing.assert_allclose(products.T @ products, dense.T @ expected @ dense, atol=1e-7)
    np.testing.assert_allclose(projected.squared_norms(),
                               np.diag(dense.T @ expected @ dense), atol=1e-7)
    # The coefficients are those of ridge regression.
    target = rng.normal(size=len(nuisance))
    solution = nuisance_coefficients(nuisance, target, spread)
    gradient = nuisance.T @ (target - nuisance @ solution) - solution / spread ** 2
    np.testing.assert_allclose(gradient, 0.0, atol=1e-8)
