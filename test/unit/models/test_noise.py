"""Noise: absolute and relative standard deviation, and the correlation time."""

from gravity_comp_ros.models import noise
from gravity_comp_ros.models.sparse import sparse_fit
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
from gravity_comp_ros.models.sparse.sparse_fit import SparseProblem, SupportFit
from gravity_comp_ros.models.sparse.support import Refit
from hypothesis import given, strategies as st
import numpy as np
import pytest


def estimate(residual: np.ndarray, load: np.ndarray) -> tuple[float, float]:
    """Return a and b of the noise sqrt(a^2 + b^2 load^2)."""
    growth, mean = noise.growth(residual, load), (load ** 2).mean()
    absolute = np.sqrt((residual ** 2 / (1.0 + growth * load ** 2 / mean)).mean())
    return float(absolute), float(absolute * np.sqrt(growth / mean))


def loads(count: int, rng: np.random.Generator) -> np.ndarray:
    return 60 * np.sin(rng.uniform(-3, 3, count))


@pytest.mark.parametrize('size', [0.01, 3.0])
def test_absolute_noise(size):
    rng = np.random.default_rng(0)
    absolute, relative = estimate(size * rng.normal(size=500), loads(500, rng))
    # Ten per cent is three standard errors of a standard deviation of 500 samples.
    assert absolute == pytest.approx(size, rel=0.1)
    assert relative * 60 < 0.5 * size


def test_both_kinds_of_noise():
    rng = np.random.default_rng(0)
    load = loads(4000, rng)
    residual = 0.2 * rng.normal(size=4000) + 0.02 * load * rng.normal(size=4000)
    absolute, relative = estimate(residual, load)
    assert absolute == pytest.approx(0.2, rel=0.15)
    assert relative == pytest.approx(0.02, rel=0.1)


def test_an_error_as_large_as_the_load_is_not_attributed_to_the_sensor():
    # The model error of a moving arm also grows with the load. It must not give samples without
    # load all the weight.
    rng = np.random.default_rng(0)
    load = loads(1000, rng)
    residual = 0.8 * load * rng.normal(size=1000)
    absolute, relative = estimate(residual, load)
    assert relative == 0.0
    absolute, relative = estimate(residual / 4, load)
    assert relative == pytest.approx(0.2, rel=0.1)


def test_degrees_of_freedom_are_corrected():
    rng = np.random.default_rng(1)
    sizes = []
    for _ in range(200):
        a, b = rng.normal(size=(40, 15)), rng.normal(size=40)
        residual = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
        sizes.append(float(noise.remaining_std(residual[:, None], np.array([15.0]), 0.0)[0]) ** 2)
    assert np.mean(sizes) == pytest.approx(1.0, abs=0.05)


def test_the_noise_has_a_floor():
    tau = np.zeros((50, 2))
    tau[:, 1] = 100.0
    floor = noise.floor(tau)
    assert floor == pytest.approx(0.01)
    assert (noise.remaining_std(np.zeros((50, 2)), np.zeros(2), floor) == floor).all()
    # So has that of zero torque.
    assert noise.floor(np.zeros((10, 2))) > 0.0


def autoregressive(phi: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return x_k = phi x_(k-1) + e_k from its stationary distribution."""
    x = rng.normal(size=count)
    x[0] /= np.sqrt(1 - phi ** 2)
    for k in range(1, count):
        x[k] += phi * x[k - 1]
    return x


@pytest.mark.parametrize('seed', range(2))
def test_white_noise_has_a_correlation_time_of_one(seed):
    residual = np.random.default_rng(seed).normal(size=500)
    time = noise.correlation_time(residual, np.zeros(500, dtype=int))
    assert 1.0 <= time < 1.5


@pytest.mark.parametrize('phi, expected', [(0.5, 3.0), (0.95, 39.0)])
def test_correlation_time_of_an_autoregression(phi, expected):
    # Its autocorrelation is phi^k, and 1 + 2 sum phi^k = (1 + phi) / (1 - phi).
    rng, runs = np.random.default_rng(3), np.zeros(20000, dtype=int)
    times = [noise.correlation_time(autoregressive(phi, 20000, rng), runs) for _ in range(5)]
    assert np.mean(times) == pytest.approx(expected, rel=0.15)


def test_samples_of_different_runs_are_independent():
    rng = np.random.default_rng(0)
    pairs = np.repeat(rng.normal(size=300), 2)
    one_run = noise.correlation_time(pairs, np.zeros(600, dtype=int))
    own_runs = noise.correlation_time(pairs, np.arange(600))
    # The lag-1 autocorrelation of pairs of equal values is 0.5: 1 + 2 * 0.5.
    assert one_run == pytest.approx(2.0, abs=0.3) and own_runs == 1.0


@given(st.lists(st.floats(-1e6, 1e6), max_size=12))
def test_correlation_time_is_at_least_one(values):
    residual = np.array(values)
    assert 1.0 <= noise.correlation_time(residual, np.zeros(len(values), dtype=int)) < np.inf


def correlated(time: float, count: int = 1000) -> tuple[SparseProblem, SupportFit]:
    """Return a problem with an autoregressive residual and an empty support."""
    rng, phi = np.random.default_rng(0), (time - 1) / (time + 1)
    residual = rng.normal(size=count)
    for k in range(1, count):
        residual[k] += phi * residual[k - 1]
    tau = residual[:, None]
    problem = SparseProblem(TorqueDesign, rng.uniform(-1, 1, (count, 1)), tau,
                            np.zeros(count, dtype=int), np.arange(count) * 5 // count,
                            np.ones(3, dtype=bool))
    return problem, SupportFit(Refit.empty(), tau, tau.std(axis=0), 1)


@pytest.mark.parametrize('errors, selected', [
    ([[5, 2, 3], [5, 2, 3], [5, 2, 3], [5, 2, 3.1], [5, 2, 3]], 3.0),      # the lowest
    ([[5, 2, 2], [5, 2, 2], [5, 2, 2], [5, 2, 2], [5, 2, 2]], 10.0),       # equal, and larger
    # The error of 10 is larger by 0.2 with a standard error of 0.37: not significant.
    ([[5, 2, 3], [5, 2, 1], [5, 2, 3], [5, 2, 2], [5, 2, 2]], 10.0)])
def test_the_largest_within_a_standard_error_of_the_best(monkeypatch, errors, selected):
    remaining = [np.array(row, dtype=float) for row in errors]
    monkeypatch.setattr(sparse_fit, '_held_out', lambda *args: remaining.pop(0))
    assert sparse_fit.choose_inflation(*correlated(9.0)) == selected


@pytest.mark.parametrize('share', [0.24, 0.26, 0.4])
def test_spikes_have_little_weight_whatever_their_share(share):
    """A share of 26 % must not be treated otherwise than one of 24 %."""
    rng = np.random.default_rng(0)
    residual = rng.normal(size=(1000, 1))
    hit = np.arange(1000) < 1000 * share
    residual[hit] += 100.0
    weights = noise.outlier_weights(residual)[:, 0]
    assert weights[hit].max() < 0.01 and weights[~hit].min() > 0.5


@given(st.floats(4.0, 1e6))
def test_the_evidence_of_an_outlier_is_bounded(size):
    residual = np.array([[1.0], [-1.0], [1.0], [-1.0], [1.4826 * size]])
    weight = float(noise.outlier_weights(residual)[-1, 0])
    assert 0.5 * weight * size ** 2 == pytest.approx(8.0)
