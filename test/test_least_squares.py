"""Least squares of a matrix that divide and conquer gives up on."""

from gravity_comp_ros.models.least_squares import lstsq, non_negative, svd
import numpy as np
import pytest
from scipy.optimize import nnls


def gives_up(*_, **__):
    raise np.linalg.LinAlgError('SVD did not converge in Linear Least Squares')


@pytest.mark.parametrize('rcond', [None, 1e-10])
def test_the_qr_iteration_finds_the_same(monkeypatch, rcond):
    rng = np.random.default_rng(0)
    # Of seven columns two are combinations of the others.
    x = rng.normal(size=(40, 5)) @ rng.normal(size=(5, 7))
    y = rng.normal(size=(40, 2))
    found, (u, size, v) = lstsq(x, y, rcond), svd(x)
    monkeypatch.setattr(np.linalg, 'lstsq', gives_up)
    monkeypatch.setattr(np.linalg, 'svd', gives_up)
    np.testing.assert_allclose(lstsq(x, y, rcond), found, atol=1e-9)
    again = svd(x)
    np.testing.assert_allclose(again[1], size, atol=1e-9)
    np.testing.assert_allclose((again[0] * again[1]) @ again[2], (u * size) @ v, atol=1e-9)


def test_what_is_not_finite_is_an_error():
    x = np.eye(3)
    x[0, 0] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        svd(x)
    with pytest.raises(np.linalg.LinAlgError):
        lstsq(x, np.ones(3))


@pytest.mark.parametrize('seed', range(5))
def test_the_best_numbers_that_are_not_negative(seed):
    rng = np.random.default_rng(seed)
    # As for the masses of a nominal arm: few moments, and all masses alike where these leave them.
    x = np.concatenate([rng.normal(size=(14, 100)), 0.03 * np.eye(100)])
    y = np.concatenate([rng.normal(size=14), np.zeros(100)])
    np.testing.assert_allclose(non_negative(x, y), nnls(x, y)[0], atol=1e-9)
    np.testing.assert_array_equal(non_negative(x[:, :0], y), np.zeros(0))
