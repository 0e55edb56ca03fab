"""Variance inflation factor: held-out parts, and the largest factor of similar error."""

from gravity_comp_ros.data.holdout import folds
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.sparse import sparse_fit
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions, SparseProblem, SupportFit
from gravity_comp_ros.models.sparse.support import Refit
from hypothesis import given, strategies as st
import numpy as np
import pytest


@given(counts=st.lists(st.integers(1, 9), min_size=1, max_size=8))
def test_every_sample_is_tested_once_and_runs_stay_whole(counts):
    runs = np.repeat(np.arange(len(counts)), counts)
    masks = folds(runs)
    np.testing.assert_array_equal(np.sum(masks, axis=0), np.ones(len(runs)))
    if len(counts) >= 3:
        assert len(masks) == min(5, len(counts))
        assert all(not set(runs[mask]) & set(runs[~mask]) for mask in masks)


def test_blocks_of_time_are_held_out_of_a_single_run():
    masks = folds(np.zeros(20, dtype=int))
    assert [np.flatnonzero(mask).tolist() for mask in masks] == [
        list(range(k, k + 4)) for k in range(0, 20, 4)]


def correlated(time: float, count: int = 1000) -> tuple[SparseProblem, SupportFit]:
    """Return a problem with an autoregressive residual and an empty support."""
    rng, phi = np.random.default_rng(0), (time - 1) / (time + 1)
    residual = rng.normal(size=count)
    for k in range(1, count):
        residual[k] += phi * residual[k - 1]
    tau = residual[:, None]
    problem = SparseProblem(TorqueDesign, rng.uniform(-1, 1, (count, 1)), tau,
                            np.zeros(count, dtype=int), np.ones(3, dtype=bool))
    return problem, SupportFit(Refit.empty(), noise.first_guess(tau), np.zeros_like(tau), 1)


@pytest.mark.parametrize('errors, selected', [
    ([[5, 2, 3], [5, 2, 3], [5, 2, 3], [5, 2, 3.1], [5, 2, 3]], 3.0),      # the lowest
    ([[5, 2, 2], [5, 2, 2], [5, 2, 2], [5, 2, 2], [5, 2, 2]], 10.0),       # equal, and larger
    ([[1, 2, 3], [1, 2, 3], [1, 2, 3], [1, 2, 3], [1, 2, 3.1]], 1.0),
    ([[5, 2, 1], [5, 2, 1], [5, 2, 1], [5, 2, 1], [5, 2, 1]], 10.0),
    # The error of 10 is larger by 0.2 with a standard error of 0.37: not significant.
    ([[5, 2, 3], [5, 2, 1], [5, 2, 3], [5, 2, 2], [5, 2, 2]], 10.0)])
def test_the_largest_within_a_standard_error_of_the_best(monkeypatch, errors, selected):
    remaining = [np.array(row, dtype=float) for row in errors]
    monkeypatch.setattr(sparse_fit, '_held_out', lambda *args: remaining.pop(0))
    choice = sparse_fit.choose_inflation(*correlated(9.0), SparseOptions())
    assert choice.tried == (1.0, 3.0, 10.0)
    assert choice.correlation_time == pytest.approx(9.0, rel=0.4)
    assert choice.inflation == selected
    assert choice.errors == pytest.approx(np.mean(errors, axis=0).tolist())


def test_no_factors_are_tried_for_white_residuals(monkeypatch):
    monkeypatch.setattr(sparse_fit, '_held_out', None)
    choice = sparse_fit.choose_inflation(*correlated(1.0), SparseOptions())
    assert (choice.inflation, choice.tried, choice.errors) == (1.0, (1.0,), ())
