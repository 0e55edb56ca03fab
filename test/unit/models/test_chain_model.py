"""The chain: torque, derivatives and expansion."""

from dataclasses import replace
from itertools import product

from bench.shared.serial_arms import planar_2r, random_chain
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.chain import (
    about_z, aligned, Chain, expand, in_frames_of_axes, tilt)
from gravity_comp_ros.models.sparse import sparse_change
from gravity_comp_ros.models.sparse.sparse_change import (
    average_change, ChangeProblem, find_change, propose)
from hypothesis import given, strategies as st
import numpy as np
import pytest
from scipy import stats


def test_planar_arm_by_hand():
    # Both axes level: A_1 rotates z to the horizontal, A_2 keeps it parallel. With x of frame 1
    # level and the vertical along its y, a moment m along x at q = 0 gives m cos q.
    g, m1, m2, l1, c1, c2 = 9.81, 3.0, 2.0, 0.5, 0.25, 0.2
    level = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    chain = Chain(np.stack([level, np.eye(3)]),
                  np.array([[(m1 * c1 + m2 * l1) * g, 0.0], [m2 * c2 * g, 0.0]]))
    q = np.array([[0.0, 0.0], [0.3, -0.7], [np.pi / 2, 0.0], [2.0, 1.0]])
    np.testing.assert_allclose(chain.torque(q), planar_2r(q), atol=1e-12)


def test_tilt_is_the_matrix_exponential():
    from scipy.linalg import expm
    for x, y in ((0.3, -0.2), (0.0, 0.0), (2.0, 2.5), (1e-9, 0.0)):
        skew = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
        np.testing.assert_allclose(tilt(np.array([[x, y]]))[0], expm(skew), atol=1e-12)


def test_frames_of_axes_do_not_change_gravity_and_an_arm_with_right_angles_has_sparse_moments():
    rng = np.random.default_rng(0)
    for seed in range(5):
        chain, q = random_chain(6, seed), rng.uniform(-3, 3, (50, 6))
        np.testing.assert_allclose(in_frames_of_axes(chain).torque(q), chain.torque(q),
                                   atol=1e-12)
    # Right angles and a parallel axis; every link frame is rotated about its axis at random.
    right = np.stack([aligned(np.array(z, dtype=float)) for z in (
        (0, 0, 1), (1, 0, 0), (0, 0, -1), (0, 1, 0), (-1, 0, 0))])
    moments = np.array([[0.0, 0.0], [5.0, 0.0], [3.0, 0.0], [0.0, 2.0], [1.0, 0.0]])
    turns = about_z(rng.uniform(-3, 3, 5))
    axes = right @ turns
    axes[1:] = turns[:-1].transpose(0, 2, 1) @ axes[1:]
    rotated = Chain(axes, np.einsum('nij,ni->nj', turns[:, :2, :2], moments))
    result = in_frames_of_axes(rotated)
    q = rng.uniform(-3, 3, (50, 5))
    np.testing.assert_allclose(result.torque(q), Chain(right, moments).torque(q), atol=1e-12)
    assert np.count_nonzero(np.abs(rotated.moments) > 1e-9) == 8
    assert np.count_nonzero(np.abs(result.moments) > 1e-9) == 4


@given(st.integers(1, 7), st.integers(0, 10 ** 6))
def test_jacobian_is_the_derivative(n, seed):
    chain, rng = random_chain(n, seed), np.random.default_rng(seed + 1)
    q, step = rng.uniform(-3, 3, (5, n)), rng.normal(size=4 * n)
    small = 1e-6
    numeric = (chain.moved(small * step).torque(q) - chain.moved(-small * step).torque(q)) / (
        2 * small)
    analytic = np.tensordot(step, chain.jacobian(q), axes=(0, 0)).T
    np.testing.assert_allclose(analytic, numeric, atol=1e-7 * max(1.0, np.abs(numeric).max()))


@given(st.integers(1, 7), st.integers(0, 10 ** 6))
def test_expansion_is_exact(n, seed):
    chain = random_chain(n, seed)
    q = np.random.default_rng(seed).uniform(-3, 3, (8, n))
    names = tuple(f'j{k}' for k in range(n))
    model = GravityModel.from_energy(names, 'chain', expand(chain), np.zeros(n),
                                     Coverage(-np.ones(n), np.ones(n), 1), {})
    # The expansion omits weights within rounding of the largest one.
    np.testing.assert_allclose(model.predict(q), chain.torque(q), atol=1e-6)


@pytest.mark.parametrize('axes, moments', [
    (np.zeros((2, 3, 3)), np.zeros((2, 2))), (np.eye(3)[None], np.zeros((2, 2))),
    (-np.eye(3)[None], np.zeros((1, 2))), (np.eye(3)[None], np.full((1, 2), np.nan))])
def test_invalid_chains_are_refused(axes, moments):
    with pytest.raises(DataError, match='chain'):
        Chain(axes, moments)


def problem(jumps: FloatArray, seed: int = 0, rows: int = 60, spread: float = 0.05
            ) -> ChangeProblem:
    """Return data after a change of `jumps`, in addition to the prior uncertainty."""
    rng = np.random.default_rng(seed)
    count = len(jumps)
    columns = rng.normal(size=(count, rows))
    residual = (jumps + spread * rng.normal(size=count)) @ columns + rng.normal(size=rows)
    return ChangeProblem(columns, residual, spread ** 2 * np.eye(count), np.arange(count), 10.0)


def log_evidence(given: ChangeProblem, support: np.ndarray, share: float) -> float:
    """Return ln p(r, S | s) from the dense covariance of r."""
    variance = given.covariance + np.diag(support * (share * given.size) ** 2.0)
    covariance = np.eye(len(given.residual)) + given.columns.T @ variance @ given.columns
    count, k = len(support), int(support.sum())
    orders = np.prod([(count - j) / (j + 1) for j in range(k)])
    likelihood = stats.multivariate_normal(cov=covariance).logpdf(given.residual)
    return float(likelihood - np.log(count + 1.0) - np.log(orders))


@pytest.fixture
def small() -> ChangeProblem:
    return problem(np.array([3.0, 0.0, 0.0, -0.4, 0.0]), seed=2)


def test_the_most_probable_support_is_selected(small):
    supports = list(product([False, True], repeat=5))
    best = max((log_evidence(small, np.array(support), share), support)
               for share in sparse_change._SIZES for support in supports)
    np.testing.assert_array_equal(find_change(small).support, np.flatnonzero(best[1]))


def test_l1_proposes_few_jumps_which_are_estimated_from_fewer_rows_than_parameters():
    jumps = np.zeros(30)
    jumps[[4, 17]] = 5.0, -3.0
    result, support = propose(problem(jumps, rows=25))
    assert result.converged and support[[4, 17]].all() and support.sum() <= 8
    change = find_change(problem(jumps, rows=25, spread=0.01))
    np.testing.assert_array_equal(change.support, [4, 17])
    assert change.mean == pytest.approx(jumps, abs=0.5)


def test_no_change():
    change = average_change(problem(np.zeros(12)))
    assert change.support.size == 0
    assert np.abs(change.mean).max() < 0.2
    # Exactly known parameters do not change.
    given = problem(np.array([2.0, 0.0, 0.0]))
    fixed = ChangeProblem(given.columns, given.residual, np.zeros((3, 3)), np.array([0]), 10.0)
    change = average_change(fixed)
    assert change.mean[1:] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert change.mean[0] == pytest.approx(2.0, abs=0.4)


def test_the_intervals_cover_95_percent():
    inside = []
    for seed in range(40):
        rng = np.random.default_rng(1000 + seed)
        jumps = np.where(rng.random(8) < 0.4, rng.normal(scale=2.0, size=8), 0.0)
        given = problem(jumps, seed, rows=16)
        change = average_change(given, seed=seed)
        # Repeat the draws of `problem` to obtain its change by the prior uncertainty.
        again = np.random.default_rng(seed)
        again.normal(size=given.columns.shape)
        truth = jumps + 0.05 * again.normal(size=8)
        inside.append(np.abs(truth - change.mean) <= 1.96 * np.sqrt(np.diag(change.covariance)))
    assert 0.91 <= np.mean(inside) <= 0.99


def test_parameters_may_jump_together():
    together = np.array([4.0, -2.0, 0.0, 3.0, 0.0, 0.0])
    given = problem(together, seed=3, rows=12)
    path = (together / 4.0)[None]
    change = find_change(replace(given, along=path))
    np.testing.assert_array_equal(change.along, [True])
    assert set(change.support) >= {0, 1, 3} and not change.single.size
    alone = find_change(given)
    assert np.abs(change.mean - together).max() < np.abs(alone.mean - together).max() + 0.05
    assert change.log_evidence > alone.log_evidence
