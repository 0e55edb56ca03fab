"""Merging of the samples of an arm at rest."""

from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.sparse.sparse_problem import SparseProblem
from hypothesis import given, strategies as st
import numpy as np


def problem(q, tau, runs) -> SparseProblem:
    q = np.array(q, dtype=float)
    return SparseProblem(EnergyDesign, q, np.array(tau, dtype=float), np.array(runs),
                         np.ones(3 ** q.shape[1], dtype=bool))


def test_close_poses_are_merged_to_their_mean():
    q = [[0.0, 1.0], [0.001, 1.0], [0.002, 1.0], [0.0, 1.003], [0.5, 1.0], [0.5, 1.0]]
    tau = [[1, 2], [3, 2], [2, 2], [9, 9], [4, 6], [6, 6]]
    merged = problem(q, tau, [0, 0, 0, 0, 0, 1]).merged(0.0025)
    np.testing.assert_allclose(merged.q, [[0.001, 1.0], [0.0, 1.003], [0.5, 1.0], [0.5, 1.0]])
    np.testing.assert_allclose(merged.tau, [[2, 2], [9, 9], [4, 6], [6, 6]])
    assert merged.runs.tolist() == [0, 0, 0, 1]


def test_slow_creep_is_not_rest():
    q = np.linspace(0.0, 1.0, 1001)[:, None]
    merged = problem(q, 2 * q, np.zeros(1001, dtype=int)).merged(0.01)
    assert 80 < len(merged.q) < 120
    assert np.diff(merged.q[:-1, 0]).min() > 0.009
    np.testing.assert_allclose(merged.tau, 2 * merged.q)


def test_different_poses_are_not_merged():
    whole = problem([[0.0], [1.0], [2.0]], [[1], [2], [3]], [0, 0, 0])
    assert whole.merged(0.1) is whole


@given(seed=st.integers(0, 10 ** 6), count=st.integers(1, 40), runs=st.integers(1, 3))
def test_every_sample_is_near_a_merged_one(seed, count, runs):
    rng = np.random.default_rng(seed)
    q = np.cumsum(rng.choice([0.0, 0.001, 0.3], (count, 2)), axis=0)
    whole = problem(q, rng.normal(size=(count, 2)), np.sort(rng.integers(0, runs, count)))
    merged = whole.merged(0.002)
    assert set(merged.runs) == set(whole.runs)
    near = np.abs(whole.q[:, None] - merged.q[None]).max(axis=2) <= 0.002 + 1e-12
    near &= whole.runs[:, None] == merged.runs[None]
    assert near.any(axis=1).all() and near.any(axis=0).all()
