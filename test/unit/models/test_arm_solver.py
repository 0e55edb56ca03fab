"""The solver of one arm: nuisance columns, derivatives, units, and arms solved by hand."""

from dataclasses import replace

from bench.shared.serial_arms import poses
from gravity_comp_ros.models.kinematic.arm_solver import ArmProblem, ArmSolver, Nuisance
from gravity_comp_ros.models.kinematic.chain import aligned, Chain, ForwardKinematics, tilt
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

SEEDS = st.integers(0, 10 ** 6)


def random_problem(seed: int, n: int = 3, m: int = 60) -> tuple[ArmProblem, Chain]:
    """Return efforts of a random chain with friction and noise, and the chain."""
    rng = np.random.default_rng(seed)
    axes = np.stack([aligned(v / np.linalg.norm(v)) for v in rng.normal(size=(n, 3))])
    chain, q = Chain(axes, rng.normal(size=(n, 2)) * 5.0), poses(m, n)
    columns = np.stack([np.ones((n, m)), np.sign(rng.normal(size=(n, m)))], axis=1)
    friction = (rng.normal(size=(n, 2, 1)) * columns).sum(axis=1).T
    tau = chain.torque(q) + friction + 0.1 * rng.normal(size=q.shape)
    return ArmProblem(q, tau, Nuisance(columns, np.full(2, 1e3)), np.full(n, 1e-6)), chain


@given(SEEDS)
def test_a_prior_is_equivalent_to_noise_with_its_covariance(seed):
    rng = np.random.default_rng(seed)
    nuisance = Nuisance(rng.normal(size=(2, 3, 25)), np.array([0.3, 1.0, 40.0]))
    nuisance.columns[1, 2] = 0.0                            # a joint at rest has no friction
    nuisance.columns[0, 1] = 1e3 * nuisance.columns[0, 0]   # dependent, and in other units
    rows = rng.normal(size=(4, 2, 25))
    white = nuisance.whitened(rows)
    for j, columns in enumerate(nuisance.columns):
        covariance = np.eye(25) + (columns.T * nuisance.spread ** 2) @ columns
        np.testing.assert_allclose(white[:, j] @ white[:, j].T, rows[:, j] @ np.linalg.solve(
            covariance, rows[:, j].T), rtol=1e-4, atol=1e-4)
    order = [1, 0]
    np.testing.assert_array_equal(nuisance.of_joints(order).columns, nuisance.columns[order])


@settings(max_examples=10)
@given(SEEDS)
def test_columns_are_the_derivatives_of_the_effort(seed):
    problem, chain = random_problem(seed)
    rng, n = np.random.default_rng(seed), 3
    log, base = rng.normal(size=n), np.zeros((1, 2))
    shares = rng.uniform(size=(len(problem.q), 1))
    free = np.array([0, 2])
    solver = ArmSolver(problem, np.ones(2 * n, dtype=bool), free, shares)

    def effort(tilts, gains, turned, moments):
        logs = log.copy()
        logs[free] += gains
        arm = ForwardKinematics(chain.axes @ tilt(tilts.reshape(-1, 2)), problem.q, None,
                                shares @ turned.reshape(1, 2))
        torque = arm.torque(moments.reshape(-1, 2)) * np.exp(logs)
        return problem.nuisance.whitened(torque.T[None])[0]

    state = solver._state(chain.axes, log, base, problem.noise(problem.target))
    start = [np.zeros(2 * n), np.zeros(2), base.ravel(), state.chain.moments.ravel()]
    columns = np.concatenate([solver._columns(state), state.moment_columns])
    number = 0
    for k, part in enumerate(start):
        for place in range(len(part)):
            moved = [each.copy() for each in start]
            moved[k][place] += 1e-6
            slope = (effort(*moved) - effort(*start)) / 1e-6
            np.testing.assert_allclose(columns[number], slope, atol=1e-3)
            number += 1
    assert number == len(columns)


@settings(max_examples=10)
@given(SEEDS, st.floats(0.01, 100.0))
def test_the_unit_of_a_joint_shifts_the_cost_alone(seed, factor):
    problem, chain = random_problem(seed)
    units = np.array([1.0, factor, 1.0])
    scaled = replace(problem, tau=problem.tau * units, floor=problem.floor * units)
    axes, log = chain.axes, np.log(units)
    one = ArmSolver.of_axes(problem).run(axes)
    other = ArmSolver.of_axes(scaled).run(axes, log)
    shift = len(problem.q) * np.log(factor)
    assert other.cost - one.cost == pytest.approx(shift, abs=0.5)


@pytest.mark.parametrize('seed', range(3))
def test_a_gain_and_a_tilt_of_the_base_are_found(seed):
    problem, chain = random_problem(seed, n=4, m=200)
    shares = (np.arange(200) >= 100)[:, None].astype(float)
    base, gain = np.array([[0.2, -0.1]]), np.array([0.0, 0.7, 0.0, 0.0])
    arm = ForwardKinematics(chain.axes, problem.q, None, shares @ base)
    tau = arm.torque(chain.moments) * np.exp(gain)
    tau = tau + 0.01 * np.random.default_rng(seed).normal(size=tau.shape)
    free = np.array([1])
    solver = ArmSolver(replace(problem, tau=tau), np.ones(8, dtype=bool), free, shares)
    state = solver.run(chain.axes)
    np.testing.assert_allclose(state.log, gain, atol=0.01)
    np.testing.assert_allclose(state.base_tilts, base, atol=0.01)
    assert state.noise.max() < 0.012
    std = np.sqrt(np.diag(np.linalg.inv(solver.precision(state)))[8])
    assert abs(state.log[1] - 0.7) < 4.0 * std < 0.05


def test_a_pendulum_on_known_axes_by_hand():
    # A level axis with a moment of 3 N·m along x, which at q = 0 is level: tau = 3 cos q.
    q = np.linspace(-2.0, 2.0, 40)[:, None]
    axes = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]])
    problem = ArmProblem(q, 3.0 * np.cos(q), Nuisance.none(1, 40), np.full(1, 1e-6))
    state = ArmSolver(problem, np.zeros(2, dtype=bool)).run(axes)
    np.testing.assert_allclose(state.chain.moments, [[3.0, 0.0]], atol=1e-6)
    np.testing.assert_allclose(state.residual, 0.0, atol=1e-5)
