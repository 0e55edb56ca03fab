"""Sparse change of parameters under a Gaussian prior: evidence, search, averages."""

from dataclasses import replace
from itertools import product

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.sparse import sparse_change
from gravity_comp_ros.models.sparse.sparse_change import (
    average_change, ChangeProblem, find_change, propose)
import numpy as np
import pytest
from scipy import stats


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


def test_the_score_is_the_dense_evidence(small):
    evidence = sparse_change._Evidence(small, 0.3)
    constant = -0.5 * small.residual @ small.residual - 0.5 * len(small.residual) * np.log(
        2 * np.pi)
    for support in product([False, True], repeat=5):
        mask = np.array(support)
        assert evidence.score(mask) + constant == pytest.approx(
            log_evidence(small, mask, 0.3), abs=1e-8)


def test_gains_are_differences_of_scores(small):
    evidence = sparse_change._Evidence(small, 0.3)
    for support in product([False, True], repeat=5):
        mask = np.array(support)
        expected = [evidence.score(sparse_change._toggled(mask, k)) - evidence.score(mask)
                    for k in range(5)]
        np.testing.assert_allclose(evidence.gains(mask), expected, atol=1e-8)


def test_the_most_probable_support_is_selected(small):
    supports = list(product([False, True], repeat=5))
    best = max((log_evidence(small, np.array(support), share), support)
               for share in sparse_change._SIZES for support in supports)
    np.testing.assert_array_equal(find_change(small).support, np.flatnonzero(best[1]))


def test_average_is_the_sum_over_all_supports_and_sizes(small):
    scores, means, covariances = [], [], []
    for share in sparse_change._SIZES:
        evidence = sparse_change._Evidence(small, share)
        for support in product([False, True], repeat=5):
            scores.append(evidence.score(np.array(support)))
            mean, covariance = evidence.posterior(np.array(support))
            means.append(mean)
            covariances.append(covariance)
    weights = np.exp(np.array(scores) - max(scores))
    weights /= weights.sum()
    mean = weights @ np.array(means)
    off = np.array(means) - mean
    exact = np.tensordot(weights, np.array(covariances), axes=(0, 0)) + (off.T * weights) @ off
    change = average_change(small)
    np.testing.assert_allclose(change.mean, mean, atol=0.03)
    np.testing.assert_allclose(np.sqrt(np.diag(change.covariance)), np.sqrt(np.diag(exact)),
                               rtol=0.3)


def test_l1_proposes_the_jumps():
    jumps = np.zeros(30)
    jumps[[4, 17]] = 5.0, -3.0
    result, support = propose(problem(jumps, rows=25))
    assert result.converged and support[[4, 17]].all() and support.sum() <= 8


def test_few_jumps_are_estimated_from_fewer_rows_than_parameters():
    jumps = np.zeros(30)
    jumps[[4, 17]] = 5.0, -3.0
    change = find_change(problem(jumps, rows=25, spread=0.01))
    np.testing.assert_array_equal(change.support, [4, 17])
    assert change.mean == pytest.approx(jumps, abs=0.5)


def test_no_change():
    change = average_change(problem(np.zeros(12)))
    assert change.support.size == 0
    assert np.abs(change.mean).max() < 0.2


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


def test_exactly_known_parameters_do_not_change():
    given = problem(np.array([2.0, 0.0, 0.0]))
    fixed = ChangeProblem(given.columns, given.residual, np.zeros((3, 3)), np.array([0]), 10.0)
    change = average_change(fixed)
    assert change.mean[1:] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert change.mean[0] == pytest.approx(2.0, abs=0.4)


def test_a_search_continues_with_other_parameters(small):
    # The set of identifiable moments changes while the axes of a chain change.
    near = find_change(small)
    fewer = replace(small, may_change=np.array([0, 3, 4]))
    assert set(find_change(fewer, near).support) == {0, 3}
    assert set(find_change(small, find_change(fewer)).support) == {0, 3}


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
