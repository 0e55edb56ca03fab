"""Differentiation of positions: no delay, no leakage across gaps, little noise."""

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.errors import DataError
from hypothesis import given, strategies as st
import numpy as np
import pytest


@given(slope=st.floats(-3, 3), offset=st.floats(-3, 3), seed=st.integers(0, 1000),
       count=st.integers(2, 60))
def test_straight_line_is_exact_at_any_sampling(slope, offset, seed, count):
    t = np.cumsum(np.random.default_rng(seed).uniform(0.5e-2, 1.5e-2, count))
    speed = differentiate(t, (offset + slope * t)[:, None])
    np.testing.assert_allclose(speed, slope, atol=1e-9)


@pytest.mark.parametrize(('count', 'rate'), [(5, 50.0), (40, 50.0), (500, 200.0)])
def test_the_filter_is_that_of_savitzky_and_golay(count, rate):
    from scipy.signal import savgol_filter
    t = np.arange(count) / rate
    q = np.random.default_rng(count).standard_normal((count, 3))
    length = min(max(2 * round(0.1 * rate) + 1, 5), count)
    expected = savgol_filter(q, length, 3, deriv=1, delta=1.0 / rate, axis=0)
    np.testing.assert_allclose(differentiate(t, q), expected, atol=1e-9)


@pytest.mark.parametrize(('count', 'few'), [(2000, 30), (2000, 1), (300, 29), (40, 20)])
def test_some_samples_have_the_velocity_of_all(count, few):
    rng = np.random.default_rng(few)
    t = np.cumsum(rng.uniform(0.8e-2, 1.2e-2, count)) + 5.0 * (np.arange(count) > count // 3)
    q = rng.standard_normal((count, 3))
    rows = np.sort(rng.choice(count, few, replace=False))
    rows[0], rows[-1] = min(rows[0], 1), count - 1
    np.testing.assert_allclose(differentiate(t, q, rows=rows), differentiate(t, q)[rows],
                               atol=1e-9)
    assert differentiate(t, q, rows=rows[:0]).shape == (0, 3)


def test_no_leakage_across_a_gap():
    t = np.concatenate([np.arange(100), 1000 + np.arange(100)]) / 100
    q = np.concatenate([t[:100], 50 - 2 * t[100:]])[:, None]
    speed = differentiate(t, q)[:, 0]
    np.testing.assert_allclose(speed[:100], 1, atol=1e-9)
    np.testing.assert_allclose(speed[100:], -2, atol=1e-9)


def test_a_single_sample_between_gaps_has_no_velocity():
    t = np.concatenate([np.arange(20) / 10, [50.0], 100 + np.arange(20) / 10])
    speed = differentiate(t, t[:, None])[:, 0]
    assert np.isnan(speed[20])
    np.testing.assert_allclose(np.delete(speed, 20), 1)


def test_too_few_samples_have_no_velocity():
    assert np.isnan(differentiate([1.0], [[2.0]])).all()
    assert differentiate([], np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(('t', 'q'), [
    ([0.0, 1.0], [[1.0]]), ([0.0, 0.0], [[1.0], [2.0]]), ([1.0, 0.0], [[1.0], [2.0]]),
    ([0.0, 1.0], [1.0, 2.0])])
def test_invalid_input_is_refused(t, q):
    with pytest.raises(DataError, match='cannot differentiate'):
        differentiate(t, q)
