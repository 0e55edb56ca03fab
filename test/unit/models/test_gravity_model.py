"""The gravity model: torques by hand, equations in the paper's notation, the trained range."""

from concurrent.futures import ThreadPoolExecutor
import sys

from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion
from hypothesis import given, strategies as st
import numpy as np
import pytest


def model_of(*torques: dict[int, float], q_min=None, q_max=None) -> GravityModel:
    """Return a model with these weights by feature, joint by joint."""
    n = len(torques)
    expansions = tuple(Expansion(np.array(sorted(t), dtype=np.int64),
                                 np.array([t[k] for k in sorted(t)])) for t in torques)
    return GravityModel(tuple(f'j{k}' for k in range(n)), 'per_joint', expansions, None,
                        np.zeros(n), Coverage(-np.ones(n) if q_min is None else q_min,
                                              np.ones(n) if q_max is None else q_max, 10))


def test_equations_in_the_notation_of_the_paper():
    model = model_of({5: -20.81, 1: 3.1, 0: -0.5}, {})
    assert model.equation('j0') == '-20.81 s1 c2 + 3.10 s2 - 0.50 1'
    assert model.equation('j0', digits=0) == '-21 s1 c2 + 3 s2 - 0 1'
    assert model.equation('j1') == '0'
    np.testing.assert_array_equal(model.n_features(), [3, 0])
    with pytest.raises(DataError, match='no joint j9 in the model; it has j0, j1'):
        model.equation('j9')


def test_torques_by_hand():
    model = model_of({5: -20.0, 1: 3.0}, {0: 2.0})
    q = np.array([[0.3, 0.7], [-1.0, 2.0]])
    expected = np.column_stack([-20 * np.sin(q[:, 0]) * np.cos(q[:, 1]) + 3 * np.sin(q[:, 1]),
                                [2.0, 2.0]])
    np.testing.assert_allclose(model.predict(q), expected, rtol=1e-14)
    np.testing.assert_allclose(model.predict(q[0]), expected[:1], rtol=1e-14)


@given(n_joints=st.integers(1, 7), seed=st.integers(0, 10 ** 6))
def test_predict_one_agrees_with_predict(n_joints, seed):
    rng = np.random.default_rng(seed)
    model = model_of(*({int(k): float(rng.normal()) for k in rng.choice(3 ** n_joints, 3)}
                       for _ in range(n_joints)))
    q = rng.uniform(-7, 7, (4, n_joints))
    np.testing.assert_allclose([model.predict_one(pose) for pose in q], model.predict(q),
                               atol=1e-12)


def test_threads_share_a_model():
    model = model_of({5: -20.0, 1: 3.0}, {7: 2.0, 0: 1.0})
    poses = np.random.default_rng(0).uniform(-3.0, 3.0, (2, 2))
    expected = model.predict(poses)

    def worst(k):
        return max(np.abs(model.predict_one(poses[k]) - expected[k]).max() for _ in range(5000))

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            assert max(pool.map(worst, range(2))) < 1e-12
    finally:
        sys.setswitchinterval(interval)


def test_another_number_of_joints_is_refused():
    with pytest.raises(DataError, match='model of 2 joints was given poses of 3'):
        model_of({}, {}).predict(np.zeros((5, 3)))


def test_distance_from_the_trained_range():
    model = model_of({}, {}, q_min=[-1.0, 0.0], q_max=[1.0, 0.5])
    assert model.extrapolation(np.array([0.0, 0.2])) == 0.0
    assert model.extrapolation(np.array([1.0, 0.5])) == 0.0
    assert model.extrapolation(np.array([1.2, 0.2])) == pytest.approx(0.2)
    assert model.extrapolation(np.array([1.2, -0.7])) == pytest.approx(0.7)
    np.testing.assert_allclose(
        model.coverage.distance(np.array([[1.2, -0.7], [-3.0, 0.1]])), [[0.2, 0.7], [2.0, 0.0]])


def test_the_gradient_of_an_expansion_by_hand():
    # d/dq2 of 3 s1 c2 + 2 s2 + 5: -3 s1 s2 + 2 c2.
    energy = Expansion(np.array([0, 1, 5]), np.array([5.0, 2.0, 3.0]))
    gradient = energy.gradient(2, 1)
    assert dict(zip(gradient.indices.tolist(), gradient.weights)) == {2: 2.0, 4: -3.0}


@pytest.mark.parametrize('indices, weights, message', [
    ([1, 1], [1.0, 1.0], 'ascending and unique'), ([2, 1], [1.0, 1.0], 'ascending'),
    ([-1], [1.0], 'ascending'), ([1], [], 'weights'), ([[1]], [[1.0]], 'weights'),
    ([1], [np.nan], 'not finite'), ([1], [np.inf], 'not finite')])
def test_invalid_expansions_are_refused(indices, weights, message):
    with pytest.raises(DataError, match=message):
        Expansion(np.array(indices), np.array(weights))


def test_models_with_inconsistent_parts_are_refused():
    good, one = model_of({1: 1.0}, {}), Expansion(np.array([9]), np.array([1.0]))
    with pytest.raises(DataError, match='outside the dictionary of 2 joints'):
        GravityModel(good.joints, 'per_joint', (one, one), None, good.noise, good.coverage)
    with pytest.raises(DataError, match='2 joint names'):
        GravityModel(good.joints, 'per_joint', good.torques[:1], None, good.noise,
                     good.coverage)
    with pytest.raises(DataError, match='joint names'):
        GravityModel(('a', 'a'), 'per_joint', good.torques, None, good.noise, good.coverage)
