"""The dictionary of 3^N products: indices, names, features by hand, products, gradients."""

from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.models.sparse.regressor import EnergyDesign, TorqueDesign
from hypothesis import given, strategies as st
import numpy as np
import pytest


def poses(count: int, n_joints: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, n_joints))


def dense(q: np.ndarray) -> np.ndarray:
    """Return F (M, 3^N) by the definition, factor by factor."""
    rows = []
    for pose in q:
        row = np.ones(1)
        for angle in pose:
            row = np.kron(row, [1.0, np.sin(angle), np.cos(angle)])
        rows.append(row)
    return np.array(rows)


@given(st.integers(1, 12).flatmap(lambda n: st.tuples(
    st.just(n), st.lists(st.integers(0, 3 ** n - 1), min_size=1, max_size=8))))
def test_digits_and_index_are_inverse(case):
    n_joints, indices = case
    factors = dictionary.digits(np.array(indices), n_joints)
    assert factors.shape == (len(indices), n_joints)
    assert set(factors.ravel()) <= {0, 1, 2}
    np.testing.assert_array_equal(dictionary.index_of(factors), indices)
    for index, row in zip(indices, factors):
        assert int(''.join(map(str, row)), 3) == index


@pytest.mark.parametrize('index, n_joints, name', [
    (0, 7, '1'), (5, 2, 's1 c2'), (int('1000000002', 3), 10, 's1 c10')])
def test_names_are_those_of_the_paper(index, n_joints, name):
    assert dictionary.feature_name(index, n_joints) == name


@pytest.mark.parametrize('n_joints', [0, 13])
def test_too_few_or_too_many_joints(n_joints):
    with pytest.raises(DataError, match=f'{n_joints} joints; the dictionary takes 1 to 12'):
        dictionary.n_features(n_joints)
    with pytest.raises(DataError, match='joints'):
        dictionary.Halves(np.zeros((2, n_joints)))


def test_twelve_joints_are_possible():
    assert dictionary.n_features(12) == 531441
    q = poses(2, 12)
    r = np.array([1.0, -2.0])
    sample = np.random.default_rng(0).integers(0, 3 ** 12, 50)
    np.testing.assert_allclose(dictionary.Halves(q).correlate(r)[sample],
                               dictionary.columns(q, sample).T @ r, atol=1e-13)


def design_of(kind, n_joints: int, count: int = 11, seed: int = 0):
    """Return a design with uneven weights, its poses and its weights."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-3, 3, (count, n_joints))
    weights = rng.uniform(0.3, 3.0, (count, n_joints if kind is EnergyDesign else 1))
    return kind(q, weights), q, weights


@pytest.mark.parametrize('kind', [TorqueDesign, EnergyDesign])
@pytest.mark.parametrize('n_joints', [1, 2, 5])
def test_columns_products_and_lengths_agree(kind, n_joints):
    design, q, weights = design_of(kind, n_joints)
    full = design.columns(np.arange(3 ** n_joints))
    if kind is TorqueDesign:
        np.testing.assert_allclose(full, weights * dense(q))
    r = np.random.default_rng(5).normal(size=design.n_rows)
    assert full.shape == (design.n_rows, design.n_columns)
    assert design.n_rows == weights.size
    np.testing.assert_allclose(design.correlate(r), full.T @ r, atol=1e-12)
    np.testing.assert_allclose(design.squared_norms, (full ** 2).sum(axis=0), atol=1e-12)


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
