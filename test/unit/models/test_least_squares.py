"""Least squares where LAPACK's divide and conquer fails, and with non-negative solutions."""

from gravity_comp_ros.models.least_squares import lstsq, non_negative, svd
import numpy as np
import pytest
from scipy.optimize import nnls


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


@pytest.mark.parametrize('seed', range(5))
def test_non_negative_solutions(seed):
    rng = np.random.default_rng(seed)
    # As for the masses of a nominal arm: few moments, with a weak regularisation.
    x = np.concatenate([rng.normal(size=(14, 100)), 0.03 * np.eye(100)])
    y = np.concatenate([rng.normal(size=14), np.zeros(100)])
    np.testing.assert_allclose(non_negative(x, y), nnls(x, y)[0], atol=1e-9)
    np.testing.assert_array_equal(non_negative(x[:, :0], y), np.zeros(0))
