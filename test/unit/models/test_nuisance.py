"""Nuisance columns: the same products and coefficients as with their covariance as noise."""

from bench.shared.serial_arms import poses, random_chain
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem, Nuisance, WeightedNuisance
from hypothesis import given, strategies as st
import numpy as np


@given(st.integers(0, 10 ** 6))
def test_a_prior_is_equivalent_to_noise_with_its_covariance(seed):
    rng = np.random.default_rng(seed)
    nuisance = Nuisance(rng.normal(size=(2, 3, 25)), np.array([0.3, 1.0, 40.0]))
    nuisance.columns[1, 2] = 0.0                            # a joint at rest has no friction
    nuisance.columns[0, 1] = 1e3 * nuisance.columns[0, 0]   # dependent, and in other units
    weights = rng.uniform(0.5, 2.0, (2, 25))
    weighted = WeightedNuisance(nuisance, weights)
    rows, target = rng.normal(size=(4, 2, 25)), rng.normal(size=(2, 25))
    inside = weighted.inside(rows)
    products, torque = np.zeros((4, 4)), np.zeros((2, 25))
    for j, plain in enumerate(nuisance.columns):
        columns = plain * weights[j]
        lengths = np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
        std = nuisance.spread * np.linalg.norm(plain, axis=1) / lengths
        covariance = (columns.T * std ** 2) @ columns
        inverse = np.linalg.inv(np.eye(25) + covariance)
        products += rows[:, j] @ inverse @ rows[:, j].T
        torque[j] = covariance @ inverse @ target[j] / weights[j]
        np.testing.assert_allclose(weighted.whitened(target)[j], inverse @ target[j], atol=1e-6)
    flat = rows.reshape(4, -1)
    np.testing.assert_allclose(flat @ flat.T - inside @ inside.T, products, atol=1e-6)
    np.testing.assert_allclose(weighted.torque(target), torque, atol=1e-6)


def test_the_residual_is_that_of_chain_and_nuisance_terms():
    chain, q = random_chain(3, 0), poses(40, 3)
    rng = np.random.default_rng(0)
    qd = rng.normal(size=(3, 40))
    nuisance = Nuisance(np.stack([np.ones((3, 40)), np.sign(qd)], axis=1), np.full(2, 1e4))
    friction = np.array([2.0, 0.0, -1.0])[:, None] * np.sign(qd) + 0.7
    tau = chain.torque(q) + friction.T
    problem = ChainProblem(q, tau, np.full(q.shape, 10.0), nuisance)
    np.testing.assert_allclose(problem.residual(chain), 0.0, atol=1e-6)
    some = problem.select(np.arange(10))
    np.testing.assert_allclose(some.residual(chain), 0.0, atol=1e-6)
    order = [2, 0, 1]
    np.testing.assert_array_equal(nuisance.of_joints(order).columns[0], nuisance.columns[2])
    plain = ChainProblem(q, tau, np.full(q.shape, 10.0))
    np.testing.assert_allclose(plain.residual(chain), friction.T)
