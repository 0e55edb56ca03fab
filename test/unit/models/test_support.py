"""The support search: prices, steps by hand, and local optimality."""

from bench.shared.dense import DenseDesign
from gravity_comp_ros.models.least_squares import lstsq, svd
from gravity_comp_ros.models.sparse import dictionary, support
from gravity_comp_ros.models.sparse.regressor import EnergyDesign, TorqueDesign
from hypothesis import given, strategies as st
import numpy as np
import pytest

LN = np.log
ALL_OF_ONE = np.ones(3, dtype=bool)


def orthonormal(coefficients, rows: int = 20):
    """Return a design with one joint's three features as unit vectors, and its b."""
    a = np.eye(rows)[:, :3]
    return DenseDesign(a), a @ np.asarray(coefficients, dtype=float)


def test_prices_and_score_by_hand():
    price = support.costs(2, 100)
    assert price[0] == pytest.approx(LN(100) + 4 * LN(1.5))                 # 1
    assert price[1] == pytest.approx(LN(100) + 2 * LN(1.5) + 2 * LN(6))     # s2
    assert price[8] == pytest.approx(LN(100) + 4 * LN(6))                   # c1 c2
    design, b = orthonormal([1.0, 4.0, 3.0])
    kept = support.refit(design, b, np.array([1]))
    assert kept.chi2 == pytest.approx(10.0)
    assert support.score(kept, 1, 20) == pytest.approx(10.0 + LN(20) + 2 * LN(6))


@pytest.mark.parametrize('feature, factor', [(0, 1.5), (1, 6.0)])
@pytest.mark.parametrize('margin, kept', [(1e-3, True), (-1e-3, False)])
def test_a_feature_is_kept_if_and_only_if_worth_its_price(feature, factor, margin, kept):
    # In an orthonormal design, dropping k raises chi^2 by b_k^2 and saves its price.
    x = np.zeros(3)
    x[feature] = np.sqrt(LN(20) + 2 * LN(factor) + margin)
    others = np.array([10.0, 10.0, 10.0]) * (np.arange(3) != feature)
    design, b = orthonormal(x + others)
    for start in (np.arange(3), np.flatnonzero(others)):
        selected = support.select_support(design, b, start, 1, ALL_OF_ONE)
        assert (feature in selected.indices) == kept
        assert set(np.flatnonzero(others)) <= set(selected.indices)


def test_neighbours_differ_in_one_factor():
    near = support.neighbours_of(np.array([100]), 5)[0]
    own, others = (dictionary.digits(indices, 5) for indices in (np.array([100]), near))
    assert len(set(near.tolist())) == 10 and ((others != own).sum(axis=1) == 1).all()


def every_single_step(indices: np.ndarray, usable: np.ndarray, n_joints: int):
    """Yield the supports that a drop, an addition or a swap with a neighbour leads to."""
    inside = set(indices.tolist())
    outside = set(np.flatnonzero(usable).tolist()) - inside
    for k in inside:
        yield inside - {k}
        for near in set(support.neighbours_of(np.array([k]), n_joints)[0].tolist()) & outside:
            yield inside - {k} | {near}
    for k in outside:
        yield inside | {k}


@st.composite
def problems(draw):
    """Draw a design of one or two joints, a torque, usable features and a start."""
    n_joints = draw(st.integers(1, 2))
    rng = np.random.default_rng(draw(st.integers(0, 10 ** 6)))
    kind = draw(st.sampled_from([TorqueDesign, EnergyDesign]))
    count = draw(st.integers(8, 40))
    q = rng.uniform(-1, 1, (count, n_joints)) * draw(st.sampled_from([0.5, 3.0]))
    weights = rng.uniform(5, 20, (count, n_joints if kind is EnergyDesign else 1))
    design, size = kind(q, weights), 3 ** n_joints
    x = rng.normal(0, 3, size) * (rng.random(size) < 0.4)
    b = design.columns(np.arange(size)) @ x + rng.normal(size=design.n_rows)
    usable = rng.random(size) < draw(st.sampled_from([0.7, 1.0]))
    start = np.flatnonzero(rng.random(size) < 0.5)
    return design, b, n_joints, usable, start


@given(problems())
def test_no_single_step_lowers_the_score_of_a_selected_support(problem):
    design, b, n_joints, usable, start = problem
    before = support.refit(design, b, start[usable[start]])
    selected = support.select_support(design, b, start, n_joints, usable)
    assert usable[selected.indices].all()
    score = support.score(selected, n_joints, design.n_rows)
    assert score <= support.score(before, n_joints, design.n_rows) + 1e-6
    for other in every_single_step(selected.indices, usable, n_joints):
        refit = support.refit(design, b, np.array(sorted(other), dtype=np.int64))
        # Dependent columns change the score by rounding errors only.
        assert support.score(refit, n_joints, design.n_rows) > score - 1e-3
    again = support.select_support(design, b, selected.indices, n_joints, usable)
    np.testing.assert_array_equal(again.indices, selected.indices)


@pytest.mark.parametrize('samples', [15, 40])
def test_the_search_ends_despite_rounding(samples):
    # Over 0.05 rad all features are nearly collinear, and the torque is 10^5 times its noise.
    rng = np.random.default_rng(0)
    q = 0.3 + 0.05 * rng.uniform(-1, 1, (samples, 5))
    torque = 40 * np.sin(q[:, 0]) * np.cos(q[:, 1]) + 9 * np.cos(q[:, 3])
    design = TorqueDesign(q, np.full((samples, 1), 1e4))
    b = 1e4 * (torque + 1e-4 * rng.normal(size=samples))
    search = support._Search(b, 5, support.gram_of(design, np.ones(243, dtype=bool)),
                             np.arange(0, 243, 20))
    assert not all(search.step() for _ in range(100))
    best = support.refit(design, b, search.support)
    near = support.equivalents(b, best, 5, search.gram)
    assert np.isfinite(best.x).all() and all(len(other) == len(best.indices) for other in near)


def test_the_simplest_of_dependent_columns_is_kept():
    # Joint 2 is at rest at 0.5: s1 s2 and s1 c2 are copies of s1, which is cheaper.
    rng = np.random.default_rng(2)
    q = np.column_stack([rng.uniform(-2, 2, 50), np.full(50, 0.5)])
    design = TorqueDesign(q, np.full((50, 1), 10.0))
    b = 10 * (7 * np.sin(q[:, 0]) + 0.1 * rng.normal(size=50))
    selected = support.select_support(design, b, np.arange(9), 2, np.ones(9, dtype=bool))
    np.testing.assert_array_equal(selected.indices, [3])
    assert selected.x[0] == pytest.approx(7.0, abs=0.1)


@pytest.mark.parametrize('kind', [TorqueDesign, EnergyDesign])
def test_a_true_small_support_is_selected(kind):
    rng = np.random.default_rng(0)
    q = rng.uniform(-2.5, 2.5, (200, 4))
    truth = np.sort(1 + rng.choice(80, 5, replace=False))
    x = rng.choice([-1, 1], 5) * rng.uniform(1, 20, 5)
    design = kind(q, np.full((200, 4 if kind is EnergyDesign else 1), 10.0))
    b = design.columns(truth) @ x + rng.normal(size=design.n_rows)
    start = rng.choice(81, 12, replace=False)
    selected = support.select_support(design, b, start, 4, np.ones(81, dtype=bool))
    np.testing.assert_array_equal(selected.indices, truth)
    columns = design.columns(truth)
    std = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    assert (np.abs(selected.x - x) < 5 * std).all()


def equivalents_of(design, b, indices):
    best = support.refit(design, b, np.array(indices))
    near = support.equivalents(b, best, 1, support.gram_of(design, ALL_OF_ONE))
    return [other.tolist() for other in near]


@pytest.mark.parametrize('difference, near', [(7.9, [[2]]), (8.1, [])])
def test_supports_of_similar_score_are_equivalent(difference, near):
    # With c1 instead of s1, chi^2 is larger by the difference of the squares.
    design, b = orthonormal([0.0, np.sqrt(20.0), np.sqrt(20.0 - difference)])
    assert equivalents_of(design, b, [1]) == near


def test_an_empty_support_stays_empty_on_noise():
    rng = np.random.default_rng(0)
    q = rng.uniform(-2, 2, (300, 4))
    design = TorqueDesign(q, np.ones((300, 1)))
    sizes = [support.select_support(design, rng.normal(size=300), np.arange(0, 81, 9), 4,
                                    np.ones(81, dtype=bool)).indices.size for _ in range(20)]
    assert sum(sizes) <= 2


def fails(*_, **__):
    raise np.linalg.LinAlgError('SVD did not converge in Linear Least Squares')


@pytest.mark.parametrize('rcond', [None, 1e-10])
def test_the_qr_iteration_has_the_same_result(monkeypatch, rcond):
    rng = np.random.default_rng(0)
    # Two of seven columns are combinations of the others.
    x = rng.normal(size=(40, 5)) @ rng.normal(size=(5, 7))
    y = rng.normal(size=(40, 2))
    expected, (u, size, v) = lstsq(x, y, rcond), svd(x)
    monkeypatch.setattr(np.linalg, 'lstsq', fails)
    monkeypatch.setattr(np.linalg, 'svd', fails)
    np.testing.assert_allclose(lstsq(x, y, rcond), expected, atol=1e-9)
    again = svd(x)
    np.testing.assert_allclose(again[1], size, atol=1e-9)
    np.testing.assert_allclose((again[0] * again[1]) @ again[2], (u * size) @ v, atol=1e-9)


def test_input_that_is_not_finite_is_an_error():
    x = np.eye(3)
    x[0, 0] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        svd(x)
    with pytest.raises(np.linalg.LinAlgError):
        lstsq(x, np.ones(3))
