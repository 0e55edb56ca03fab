"""The support search: prices, steps by hand, and local optimality."""

from bench.shared.dense import DenseDesign
from gravity_comp_ros.models.least_squares import lstsq, svd
from gravity_comp_ros.models.sparse import support
from gravity_comp_ros.models.sparse.lasso import LassoProblem
from gravity_comp_ros.models.sparse.regressor import EnergyDesign, TorqueDesign
from gravity_comp_ros.models.sparse.support import select_support
from hypothesis import given, strategies as st
import numpy as np
import pytest

LN = np.log


def select(design, b, *starts, usable=None):
    """Return the support that a search reaches if all features are in the working set."""
    size = design.n_columns
    usable = np.ones(size, dtype=bool) if usable is None else usable
    return select_support(LassoProblem(design, b, usable), round(np.log(size) / np.log(3)),
                          *starts, np.arange(size))


def orthonormal(coefficients, rows: int = 20):
    """Return a design with one joint's three features as unit vectors, and its b."""
    a = np.eye(rows)[:, :3]
    return DenseDesign(a), a @ np.asarray(coefficients, dtype=float)


def test_prices_and_score_by_hand():
    price = support.costs(2, 100)
    assert price[0] == pytest.approx(LN(100) + 4 * LN(1.5))                 # 1
    assert price[1] == pytest.approx(LN(100) + 2 * LN(1.5) + 2 * LN(6))     # s2
    assert price[8] == pytest.approx(LN(100) + 4 * LN(6))                   # c1 c2
    selected = select(*orthonormal([1.0, 4.0, 1.0]))
    assert selected.indices.tolist() == [1]
    assert selected.score == pytest.approx(2.0 + LN(20) + 2 * LN(6))


@pytest.mark.parametrize('feature, factor', [(0, 1.5), (1, 6.0)])
@pytest.mark.parametrize('margin, kept', [(1e-3, True), (-1e-3, False)])
def test_a_feature_is_kept_if_and_only_if_worth_its_price(feature, factor, margin, kept):
    # In an orthonormal design, dropping k raises chi^2 by b_k^2 and saves its price.
    x = np.zeros(3)
    x[feature] = np.sqrt(LN(20) + 2 * LN(factor) + margin)
    others = np.array([10.0, 10.0, 10.0]) * (np.arange(3) != feature)
    selected = select(*orthonormal(x + others), np.flatnonzero(others))
    assert (feature in selected.indices) == kept
    assert set(np.flatnonzero(others)) <= set(selected.indices)


def score_of(design, b, n_joints, indices):
    """Return the score of a support by its definition."""
    a = design.columns(indices)
    residual = b - a @ np.linalg.lstsq(a, b, rcond=1e-12)[0]
    return residual @ residual + support.costs(n_joints, design.n_rows)[indices].sum()


def every_single_step(indices: np.ndarray, usable: np.ndarray):
    """Yield the supports that a drop, an addition or a swap leads to."""
    inside = set(indices.tolist())
    outside = set(np.flatnonzero(usable).tolist()) - inside
    for k in inside:
        yield inside - {k}
        yield from (inside - {k} | {other} for other in outside)
    yield from (inside | {k} for k in outside)


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
    selected = select(design, b, start, usable=usable)
    assert usable[selected.indices].all()
    assert selected.score == pytest.approx(score_of(design, b, n_joints, selected.indices),
                                           abs=1e-3)
    for other in every_single_step(selected.indices, usable):
        # Dependent columns change the score by rounding errors only.
        assert score_of(design, b, n_joints, np.array(sorted(other), dtype=np.int64)
                        ) > selected.score - 1e-3


@pytest.mark.parametrize('samples', [15, 40])
def test_the_search_ends_despite_rounding(samples, monkeypatch):
    # Over 0.05 rad all features are nearly collinear, and the torque is 10^5 times its noise.
    rng = np.random.default_rng(0)
    q = 0.3 + 0.05 * rng.uniform(-1, 1, (samples, 5))
    torque = 40 * np.sin(q[:, 0]) * np.cos(q[:, 1]) + 9 * np.cos(q[:, 3])
    design = TorqueDesign(q, np.full((samples, 1), 1e4))
    b = 1e4 * (torque + 1e-4 * rng.normal(size=samples))
    best = select(design, b, np.arange(0, 243, 20))
    assert np.isfinite(best.x).all()
    monkeypatch.setattr(support, '_MAX_STEPS', 100)
    assert select(design, b, np.arange(0, 243, 20)).score == best.score


def test_the_simplest_of_dependent_columns_is_kept():
    # Joint 2 is at rest at 0.5: s1 s2 and s1 c2 are copies of s1, which is cheaper.
    rng = np.random.default_rng(2)
    q = np.column_stack([rng.uniform(-2, 2, 50), np.full(50, 0.5)])
    design = TorqueDesign(q, np.full((50, 1), 10.0))
    b = 10 * (7 * np.sin(q[:, 0]) + 0.1 * rng.normal(size=50))
    selected = select(design, b)
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
    selected = select(design, b, rng.choice(81, 12, replace=False))
    np.testing.assert_array_equal(selected.indices, truth)
    columns = design.columns(truth)
    std = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    assert (np.abs(selected.x - x) < 5 * std).all()


@pytest.mark.parametrize('difference, near', [(7.9, [2]), (8.1, [])])
def test_features_of_similar_score_are_equivalent(difference, near):
    # Two nearly equal columns. With the other one, chi^2 is larger by the difference.
    angle = 0.3
    a = np.eye(20)[:, :3]
    a[:, 2] = np.cos(angle) * a[:, 1] + np.sin(angle) * a[:, 2]
    selected = select(DenseDesign(a), np.sqrt(difference) / np.sin(angle) * a[:, 1])
    assert selected.indices.tolist() == [1] and selected.equivalent.tolist() == near


def test_an_empty_support_stays_empty_on_noise():
    rng = np.random.default_rng(0)
    q = rng.uniform(-2, 2, (300, 4))
    design = TorqueDesign(q, np.ones((300, 1)))
    sizes = [select(design, rng.normal(size=300)).indices.size for _ in range(20)]
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
