"""ADMM on a few columns: known solutions, optimality, and reported failure."""

from bench.shared.dense import breach, coordinate_descent, objective
from gravity_comp_ros.errors import FitError, OptionError
from gravity_comp_ros.models.sparse import admm
from hypothesis import given, strategies as st
import numpy as np
import pytest


def fresh(k: int, rho: float = 0.1) -> admm.AdmmState:
    return admm.AdmmState(np.zeros(k), np.zeros(k), rho)


def unit_columns(a: np.ndarray) -> np.ndarray:
    return a / np.linalg.norm(a, axis=0)


def solve(a, b, lam, **options) -> admm.AdmmResult:
    k = a.shape[1]
    return admm.solve(a.T @ a, a.T @ b, np.broadcast_to(float(lam), k), fresh(k),
                      admm.AdmmOptions(**options))


@pytest.mark.parametrize('c, lam, x', [(5.0, 2.0, 3.0), (-5.0, 2.0, -3.0), (1.0, 2.0, 0.0)])
def test_one_dimension_by_hand(c, lam, x):
    # min 1/2 x^2 - c x + lam |x| is solved by the soft threshold of c.
    result = admm.solve(np.eye(1), np.array([c]), np.array([lam]), fresh(1))
    assert result.converged and result.state.z[0] == pytest.approx(x, abs=1e-9)


def test_two_dimensions_by_hand():
    # G = [[1, .5], [.5, 1]], c = (3, 2.5), lam = 1: both positive, G x = c - 1 -> (5/3, 2/3).
    gram = np.array([[1.0, 0.5], [0.5, 1.0]])
    result = admm.solve(gram, np.array([3.0, 2.5]), np.ones(2), fresh(2))
    np.testing.assert_allclose(result.state.z, [5 / 3, 2 / 3], atol=1e-9)


def test_no_columns():
    result = admm.solve(np.zeros((0, 0)), np.zeros(0), np.zeros(0), fresh(0))
    assert result.converged and result.iterations == 0


@st.composite
def problems(draw):
    """Draw A with unit columns, possibly copies or nearly equal, b, and a share of lambda."""
    rng = np.random.default_rng(draw(st.integers(0, 10 ** 6)))
    rows, k = draw(st.integers(3, 25)), draw(st.integers(1, 12))
    a = rng.normal(size=(rows, k))
    collinearity = draw(st.sampled_from(['none', 'copy', 'mirror', 'near', 'all near']))
    if k > 1 and collinearity in ('copy', 'mirror'):
        a[:, 1] = a[:, 0] * (1 if collinearity == 'copy' else -1)
    if k > 1 and collinearity == 'near':
        a[:, 1] = a[:, 0] + 1e-4 * rng.normal(size=rows)
    if collinearity == 'all near':
        a = a[:, :1] + 0.03 * a
    b = rng.normal(size=rows) * draw(st.sampled_from([1e-3, 1.0, 1e3]))
    return unit_columns(a), b, draw(st.floats(0.01, 0.95))


@given(problems())
def test_every_solution_is_optimal_and_as_good_as_coordinate_descent(problem):
    a, b, share = problem
    lam = share * np.abs(a.T @ b).max()
    penalties = np.full(a.shape[1], lam)
    result = solve(a, b, lam)
    x = result.state.z
    assert result.converged
    assert breach(a, b, penalties, x) <= 1.1e-7
    # For nearly collinear columns coefficients may differ and coordinate descent is slow, but the
    # predictions differ by at most sqrt(2 (theirs - ours)).
    reference = coordinate_descent(a, b, penalties, sweeps=500)
    ours, theirs = (objective(a, b, penalties, v) for v in (x, reference))
    assert ours <= theirs * (1 + 1e-9)
    assert np.linalg.norm(a @ (x - reference)) <= (
        np.sqrt(2 * max(theirs - ours, 0.0)) + 1e-5 * np.linalg.norm(b))


@given(problems(), st.integers(0, 10 ** 6))
def test_penalties_may_differ(problem, seed):
    a, b, share = problem
    spread = np.random.default_rng(seed).uniform(0.5, 2.0, a.shape[1])
    penalties = share * np.abs(a.T @ b).max() * spread
    result = admm.solve(a.T @ a, a.T @ b, penalties, fresh(a.shape[1]))
    assert result.converged
    assert breach(a, b, penalties, result.state.z) <= 1e-6


@given(problems(), st.floats(0.01, 0.9))
def test_a_warm_start_has_the_same_solution_and_is_not_slower(problem, other_share):
    a, b, share = problem
    top, k = np.abs(a.T @ b).max(), a.shape[1]
    gram, c, penalties = a.T @ a, a.T @ b, np.full(a.shape[1], share * top)
    cold = admm.solve(gram, c, penalties, fresh(k))
    elsewhere = admm.solve(gram, c, np.full(k, other_share * top), fresh(k)).state
    warm = admm.solve(gram, c, penalties, elsewhere)
    assert warm.converged
    np.testing.assert_allclose(a @ warm.state.z, a @ cold.state.z,
                               atol=1e-4 * np.linalg.norm(b))
    again = admm.solve(gram, c, penalties, cold.state)
    assert again.iterations <= cold.iterations


@pytest.mark.parametrize('rho, relaxation', [(1e-3, 1.0), (0.1, 1.6), (100.0, 1.9)])
def test_rho_and_relaxation_do_not_change_the_solution(rho, relaxation):
    rng = np.random.default_rng(4)
    a, b = unit_columns(rng.normal(size=(20, 10))), rng.normal(size=20)
    lam = 0.1 * np.abs(a.T @ b).max()
    result = solve(a, b, lam, rho=rho, over_relaxation=relaxation)
    np.testing.assert_allclose(result.state.z, coordinate_descent(a, b, np.full(10, lam)),
                               atol=1e-6)


def hard() -> tuple[np.ndarray, np.ndarray, float]:
    rng = np.random.default_rng(2)
    a = unit_columns(rng.normal(size=(40, 1)) + 0.01 * rng.normal(size=(40, 60)))
    b = rng.normal(size=40)
    return a, b, 1e-4 * np.abs(a.T @ b).max()


def test_failure_to_converge_is_reported(monkeypatch):
    # Three iterations without a polish are not sufficient.
    monkeypatch.setattr(admm, 'polish', lambda gram, c, penalties, z, tolerance: 0 * z)
    a, b, lam = hard()
    result = solve(a, b, lam, max_iterations=3)
    assert not result.converged and not result.polished and result.iterations == 3
    assert result.violation > 1e-3
    assert result.violation == pytest.approx(
        breach(a, b, np.full(60, lam), result.state.z), rel=1e-6)
    assert max(result.primal_residual, result.dual_residual) > 1e-3


def test_admm_converges_without_the_polish(monkeypatch):
    monkeypatch.setattr(admm, 'polish', lambda gram, c, penalties, z, tolerance: 0 * z)
    rng = np.random.default_rng(7)
    a, b = unit_columns(rng.normal(size=(30, 12))), rng.normal(size=30)
    lam = 0.1 * np.abs(a.T @ b).max()
    result = solve(a, b, lam)
    assert result.converged and not result.polished
    assert result.primal_residual < 1e-6 and result.dual_residual < 1e-6
    np.testing.assert_allclose(result.state.z, coordinate_descent(a, b, np.full(12, lam)),
                               atol=1e-6)


def test_the_polish_solves_a_hard_problem_early():
    a, b, lam = hard()
    result = solve(a, b, lam)
    assert result.converged and result.iterations <= 2000
    # The residuals are those of the polished point.
    assert result.polished
    assert result.primal_residual <= 1e-6 and result.dual_residual <= 1e-6
    assert breach(a, b, np.full(60, lam), result.state.z) <= 1.1e-7


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_input_that_is_not_finite_is_refused(value):
    with pytest.raises(FitError, match='not finite'):
        admm.solve(np.eye(2), np.array([1.0, value]), np.ones(2), fresh(2))
    with pytest.raises(FitError, match='not finite'):
        admm.solve(np.full((2, 2), value), np.ones(2), np.ones(2), fresh(2))


@pytest.mark.parametrize('option, value', [
    ('max_iterations', 0), ('polish_every', 0), ('tolerance', 0.0), ('tolerance', 1.0),
    ('tolerance', float('nan')), ('over_relaxation', 0.9), ('over_relaxation', 2.0),
    ('rho', 0.0), ('rho', -1.0), ('rho', float('inf')), ('rho', float('nan'))])
def test_options_out_of_range(option, value):
    with pytest.raises(OptionError, match=option.split('_')[0]):
        admm.AdmmOptions(**{option: value})


def test_the_polish_of_an_empty_support_stays_empty():
    # Older releases of SciPy refuse to factorise an empty matrix.
    z = admm.polish(np.eye(2), np.array([0.5, -0.5]), np.ones(2), np.zeros(2), 1e-9)
    assert z.tolist() == [0.0, 0.0]
