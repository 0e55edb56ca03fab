"""Design matrices: products without the matrix agree with those of the built matrix."""

from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.models.sparse.regressor import EnergyDesign, TorqueDesign
from hypothesis import given, strategies as st
import numpy as np
import pytest


def design_of(kind, n_joints: int, count: int = 11, seed: int = 0):
    """Return a design with uneven weights, its poses and its weights."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-3, 3, (count, n_joints))
    weights = rng.uniform(0.3, 3.0, (count, n_joints if kind is EnergyDesign else 1))
    return kind(q, weights), q, weights


@pytest.mark.parametrize('kind', [TorqueDesign, EnergyDesign])
@pytest.mark.parametrize('n_joints', [1, 2, 3, 5])
def test_columns_products_and_lengths_agree(kind, n_joints):
    design, q, weights = design_of(kind, n_joints)
    full = design.columns(np.arange(3 ** n_joints))
    r = np.random.default_rng(5).normal(size=design.n_rows)
    assert full.shape == (design.n_rows, design.n_columns)
    assert design.n_rows == weights.size
    np.testing.assert_allclose(design.correlate(r), full.T @ r, atol=1e-12)
    np.testing.assert_allclose(design.squared_norms(), (full ** 2).sum(axis=0), atol=1e-12)


def test_torque_columns_are_weighted_features():
    design, q, weights = design_of(TorqueDesign, 3)
    selected = np.array([0, 4, 20])
    np.testing.assert_allclose(design.columns(selected), weights * dictionary.columns(q, selected))


@pytest.mark.parametrize('n_joints', [1, 3])
def test_energy_columns_are_gradients(n_joints):
    design, q, weights = design_of(EnergyDesign, n_joints)
    features, h = np.arange(3 ** n_joints), 1e-6
    blocks = design.columns(features).reshape(n_joints, len(q), -1)
    for joint in range(n_joints):
        step = np.zeros(n_joints)
        step[joint] = h
        numeric = (dictionary.columns(q + step, features)
                   - dictionary.columns(q - step, features)) / (2 * h)
        np.testing.assert_allclose(blocks[joint], weights[:, [joint]] * numeric, atol=1e-8)


def energy_model(n_joints: int, seed: int) -> GravityModel:
    rng = np.random.default_rng(seed)
    indices = np.sort(rng.choice(3 ** n_joints, min(8, 3 ** n_joints), replace=False))
    return GravityModel.from_energy(
        tuple(f'j{k}' for k in range(n_joints)), 'potential',
        Expansion(indices, rng.normal(0, 10, len(indices))), np.zeros(n_joints),
        Coverage(-np.ones(n_joints), np.ones(n_joints), 10), {})


@given(n_joints=st.integers(2, 5), seed=st.integers(0, 10 ** 6))
def test_a_torque_from_an_energy_has_no_curl(n_joints, seed):
    model, h = energy_model(n_joints, seed), 1e-6
    q = np.random.default_rng(seed).uniform(-3, 3, n_joints)
    jacobian = np.array([(model.predict(q + h * e)[0] - model.predict(q - h * e)[0]) / (2 * h)
                         for e in np.eye(n_joints)])
    assert np.abs(jacobian).max() > 0
    np.testing.assert_allclose(jacobian, jacobian.T, atol=1e-6)


@given(seed=st.integers(0, 10 ** 6))
def test_torque_of_an_energy_is_the_design_times_its_weights(seed):
    model = energy_model(3, seed)
    q = np.random.default_rng(seed).uniform(-3, 3, (4, 3))
    design = EnergyDesign(q, np.ones((4, 3)))
    torque = (design.columns(model.energy.indices) @ model.energy.weights).reshape(3, 4).T
    np.testing.assert_allclose(model.predict(q), torque, atol=1e-10)
