"""ADMM on a few columns, and the L1 problem on a working set: known solutions, optimality."""

from bench.shared.dense import breach, coordinate_descent, DenseDesign, objective
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models.sparse import admm, lasso as lasso_problem
from gravity_comp_ros.models.sparse.lasso import LassoProblem, LassoSolution
from gravity_comp_ros.models.sparse.regressor import Design, EnergyDesign, TorqueDesign
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


def test_no_columns():
    result = admm.solve(np.zeros((0, 0)), np.zeros(0), np.zeros(0), fresh(0))
    assert result.converged and result.iterations == 0
    # Older releases of SciPy refuse to factorise an empty matrix.
    z = admm.polish(np.eye(2), np.array([0.5, -0.5]), np.ones(2), np.zeros(2), 1e-9)
    assert z.tolist() == [0.0, 0.0]


@st.composite
def problems(draw):
    """Draw A with unit columns, copies or nearly equal, b, and penalties as shares of lambda."""
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
    spread = rng.uniform(0.5, 2.0, k) if draw(st.booleans()) else np.ones(k)
    return unit_columns(a), b, draw(st.floats(0.01, 0.95)), spread


@given(problems())
def test_every_solution_is_optimal_and_as_good_as_coordinate_descent(problem):
    a, b, share, spread = problem
    penalties = share * np.abs(a.T @ b).max() * spread
    result = admm.solve(a.T @ a, a.T @ b, penalties, fresh(a.shape[1]))
    x = result.state.z
    assert result.converged
    assert breach(a, b, penalties, x) <= 1e-6
    # For nearly collinear columns coefficients may differ and coordinate descent is slow, but the
    # predictions differ by at most sqrt(2 (theirs - ours)).
    reference = coordinate_descent(a, b, penalties, sweeps=500)
    ours, theirs = (objective(a, b, penalties, v) for v in (x, reference))
    assert ours <= theirs * (1 + 1e-9)
    assert np.linalg.norm(a @ (x - reference)) <= (
        np.sqrt(2 * max(theirs - ours, 0.0)) + 1e-5 * np.linalg.norm(b))


@given(problems(), st.floats(0.01, 0.9))
def test_a_warm_start_has_the_same_solution_and_is_not_slower(problem, other_share):
    a, b, share, _ = problem
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


def full_matrix(design: Design) -> np.ndarray:
    return design.columns(np.arange(design.n_columns))


def lasso(design: Design, b: np.ndarray, usable=None, **options) -> LassoProblem:
    usable = np.ones(design.n_columns, dtype=bool) if usable is None else usable
    return LassoProblem(design, b, usable, admm.AdmmOptions(**options))


def dense_x(solution: LassoSolution, n_columns: int) -> np.ndarray:
    x = np.zeros(n_columns)
    x[solution.indices] = solution.x
    return x


def check_certificate(a: np.ndarray, b: np.ndarray, solution: LassoSolution) -> None:
    """Compare objective, dual objective and gap with dense algebra."""
    x, lengths = dense_x(solution, a.shape[1]), np.linalg.norm(a, axis=0)
    unit = a[:, lengths > 1e-9 * lengths.max()] / lengths[lengths > 1e-9 * lengths.max()]
    primal = objective(a, b, solution.lam * lengths, x)
    residual = b - a @ x
    point = residual * min(1.0, solution.lam / np.abs(unit.T @ residual).max())
    dual = 0.5 * b @ b - 0.5 * np.sum((b - point) ** 2)
    certificate = solution.certificate
    assert certificate.objective == pytest.approx(primal, rel=1e-9)
    assert certificate.dual_objective == pytest.approx(dual, rel=1e-6, abs=1e-9 * primal)
    assert certificate.gap == pytest.approx((primal - dual) / primal, abs=1e-9)
    assert np.abs(unit.T @ point).max() <= solution.lam * (1 + 1e-9)
    z = (x * lengths)[lengths > 1e-9 * lengths.max()]
    step = admm.soft_threshold(z + unit.T @ residual, solution.lam)
    scale = max(np.abs(z).max(), 1.0)
    assert certificate.primal_residual == pytest.approx(np.linalg.norm(z - step),
                                                        rel=1e-6, abs=1e-8 * scale)


@st.composite
def torques(draw):
    """Draw a design of 1 to 5 joints, a sparse torque with noise, and a share of lambda."""
    n_joints, count = draw(st.integers(1, 5)), draw(st.integers(4, 40))
    rng = np.random.default_rng(draw(st.integers(0, 10 ** 6)))
    kind = draw(st.sampled_from([TorqueDesign, EnergyDesign]))
    q = rng.uniform(-1, 1, (count, n_joints)) * draw(st.sampled_from([0.3, 3.0]))
    if draw(st.booleans()):
        q[:, rng.integers(n_joints)] = rng.uniform(-3, 3)   # columns that are copies
    weights = rng.uniform(0.5, 2.0, (count, n_joints if kind is EnergyDesign else 1))
    design = kind(q, weights)
    x = np.zeros(design.n_columns)
    x[rng.choice(design.n_columns, min(4, design.n_columns), replace=False)] = rng.normal(
        0, 10, min(4, design.n_columns))
    b = full_matrix(design) @ x + draw(st.sampled_from([1e-2, 1.0])) * rng.normal(
        size=design.n_rows)
    return design, b, draw(st.floats(0.02, 0.9))


@given(torques())
def test_every_solution_is_optimal_over_all_columns(problem):
    design, b, share = problem
    a, problem = full_matrix(design), lasso(design, b)
    lengths = np.linalg.norm(a, axis=0)
    nonzero = lengths > 1e-9 * lengths.max()
    solution = problem.solve(share * np.abs(b @ (a[:, nonzero] / lengths[nonzero])).max())
    assert solution.converged
    assert nonzero[solution.indices].all()
    x = dense_x(solution, design.n_columns)
    assert breach(a[:, nonzero], b, solution.lam * lengths[nonzero], x[nonzero]) <= 1e-6
    check_certificate(a, b, solution)
    assert -1e-9 <= solution.certificate.gap <= 1e-6
    assert solution.certificate.violation <= 1e-6
    assert solution.certificate.dual_residual <= 1e-6 * solution.lam
    # A 2-norm over all columns, in which many small violations add up.
    assert solution.certificate.primal_residual <= 1e-6 * solution.lam * np.sqrt(a.shape[1])


def pendulum() -> tuple[TorqueDesign, np.ndarray]:
    rng = np.random.default_rng(3)
    q = rng.uniform(-2, 2, (60, 3))
    torque = 8 * np.sin(q[:, 0]) * np.cos(q[:, 1]) - 3 * np.sin(q[:, 2])
    return TorqueDesign(q, np.full((60, 1), 10.0)), 10 * (torque + 0.1 * rng.normal(size=60))


def test_a_solution_that_violates_the_conditions_has_not_converged(monkeypatch):
    monkeypatch.setattr(lasso_problem, '_MAX_ROUNDS', 1)
    monkeypatch.setattr(lasso_problem, '_BATCH', 1)
    solution = lasso(*pendulum()).solve(4.0)
    assert solution.certificate.violation > 1.0 and not solution.converged


def test_the_working_set_stays_small():
    rng = np.random.default_rng(0)
    q = rng.uniform(-2, 2, (300, 7))
    design = TorqueDesign(q, np.ones((300, 1)))
    b = 20 * np.sin(q[:, 1]) + 5 * np.cos(q[:, 3]) * np.sin(q[:, 1]) + rng.normal(size=300)
    solution = lasso(design, b).solve(4.0)
    assert solution.converged and solution.working_set < 400
    correlation = design.correlate(b - design.columns(solution.indices) @ solution.x)
    assert (np.abs(correlation) <= 4.0 * np.sqrt(design.squared_norms) * (1 + 1e-6)).all()


def test_unusable_columns_stay_zero():
    design, b = pendulum()
    usable = np.ones(27, dtype=bool)
    free = lasso(design, b).solve(4.0)
    usable[free.indices[0]] = False
    solution = lasso(design, b, usable).solve(4.0)
    assert free.indices[0] not in solution.indices and solution.indices.size
    a, lengths = full_matrix(design), np.linalg.norm(full_matrix(design), axis=0)
    assert breach(a[:, usable], b, 4.0 * lengths[usable],
                  dense_x(solution, 27)[usable]) <= 1e-6


def test_columns_of_zeros_are_not_selected():
    a = np.zeros((10, 3))
    a[:, 1] = 1.0
    solution = lasso(DenseDesign(a), np.full(10, 2.0)).solve(1.0)
    np.testing.assert_array_equal(solution.indices, [1])
    # 1/2 * 10 (x - 2)^2 + sqrt(10) |x|: x = 2 - sqrt(10) / 10.
    assert solution.x[0] == pytest.approx(2 - np.sqrt(10) / 10, abs=1e-8)
