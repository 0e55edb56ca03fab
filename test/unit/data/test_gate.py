"""Slow-motion gate, decisions by hand, equal online and offline; differentiated positions."""

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.gate import apply_gate, FAST, Gate, GateOptions, RATE, slow_samples
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from hypothesis import given, strategies as st
import numpy as np
import pytest


def still(t, n=2, label='run'):
    t = np.asarray(t, dtype=float)
    return JointSamples.single_run([f'j{k}' for k in range(n)], t, np.zeros((t.size, n)),
                                   np.zeros((t.size, n)), np.zeros((t.size, n)), label)


def test_speed_of_any_joint_closes_the_gate():
    gate = Gate(2, GateOptions(max_speed=(0.1, 0.2), rate_hz=None))
    assert gate.offer(0.0, np.array([0.1, 0.2])) is None
    assert gate.offer(0.1, np.array([0.101, 0.0])) == FAST
    assert gate.offer(0.2, np.array([0.0, -0.201])) == FAST
    assert gate.offer(0.3, np.array([0.0, -0.2])) is None


def test_rate_keeps_one_in_each_period():
    result = slow_samples(still(np.arange(0, 10, 0.01)), GateOptions(rate_hz=5.0))
    assert result.kept == 51 and result.total == 1000 and result.dropped == {RATE: 949}
    assert np.all(np.diff(result.samples.t) > 0.09)
    # Input at the requested rate passes in spite of jitter.
    rng = np.random.default_rng(1)
    t = np.arange(500) / 5.0 + rng.uniform(-0.04, 0.04, 500)
    assert slow_samples(still(t), GateOptions(rate_hz=5.0)).kept == 500
    # Poses at rest pass.
    rng = np.random.default_rng(2)
    t, q = np.arange(200) * 2.0, rng.uniform(-3, 3, (200, 7))
    samples = JointSamples.single_run([f'j{k}' for k in range(7)], t, q, 0 * q, 0 * q)
    result = slow_samples(samples, GateOptions())
    assert result.kept == 200 and result.dropped == {}


def test_thresholds_for_another_arm_are_refused():
    with pytest.raises(OptionError, match='3 values for 2 joints'):
        Gate(2, GateOptions(max_speed=(0.1, 0.1, 0.1)))
    with pytest.raises(OptionError, match='3 values for 2 joints'):
        slow_samples(still([0.0]), GateOptions(max_speed=(0.1, 0.1, 0.1)))


@pytest.mark.parametrize('speed', [1, 1.0, (1, 2.0)])
def test_a_refusal_names_the_limits(speed):
    t = np.arange(10) / 10.0
    fast = JointSamples.single_run(['a', 'b'], t, *(np.full((10, 2), x) for x in (0.0, 3.0, 0.0)))
    limits = '1, 2' if speed == (1, 2.0) else '1'
    with pytest.raises(DataError, match=f'under {limits} rad/s'):
        apply_gate(fast, GateOptions(max_speed=speed))


@st.composite
def recordings(draw):
    runs = []
    for run in range(draw(st.integers(1, 3))):
        steps = draw(st.lists(st.sampled_from([0.001, 0.01, 0.05, 0.2, 3.0]), max_size=40))
        t = draw(st.sampled_from([0.0, 1.7e9])) + np.cumsum(steps)
        seed = draw(st.integers(0, 2**31))
        rng = np.random.default_rng(seed)
        qd = rng.choice([0.0, 0.05, -0.1, 0.2], size=(t.size, 2), p=[0.5, 0.2, 0.2, 0.1])
        runs.append(JointSamples.single_run(['a', 'b'], t, qd * 0, qd, qd * 0, f'r{run}'))
    return concatenate(runs)


@given(recordings(), st.sampled_from([None, 1.0, 5.0, 100.0]),
       st.sampled_from([0.15, (0.07, 0.3)]))
def test_online_and_offline_decide_the_same(samples, rate, speed):
    options = GateOptions(speed, rate)
    gate, kept, dropped, run = Gate(2, options), [], {}, 0
    for k in range(len(samples)):
        if samples.runs[k] != run:
            gate.reset()
            run = samples.runs[k]
        reason = gate.offer(float(samples.t[k]), samples.qd[k])
        if reason is None:
            kept.append(k)
        else:
            dropped[reason] = dropped.get(reason, 0) + 1
    result = slow_samples(samples, options)
    np.testing.assert_array_equal(result.samples.t, samples.t[kept])
    np.testing.assert_array_equal(result.samples.qd, samples.qd[kept])
    assert result.dropped == dropped
    assert result.kept == len(kept) == len(result.samples)
    assert result.kept + sum(result.dropped.values()) == result.total == len(samples)


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


def test_no_leakage_across_a_gap():
    t = np.concatenate([np.arange(100), 1000 + np.arange(100)]) / 100
    q = np.concatenate([t[:100], 50 - 2 * t[100:]])[:, None]
    speed = differentiate(t, q)[:, 0]
    np.testing.assert_allclose(speed[:100], 1, atol=1e-9)
    np.testing.assert_allclose(speed[100:], -2, atol=1e-9)
    # A single sample between gaps has no velocity.
    t = np.concatenate([np.arange(20) / 10, [50.0], 100 + np.arange(20) / 10])
    speed = differentiate(t, t[:, None])[:, 0]
    assert np.isnan(speed[20])
    np.testing.assert_allclose(np.delete(speed, 20), 1)
    assert np.isnan(differentiate([1.0], [[2.0]])).all()
    assert differentiate([], np.empty((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(('t', 'q'), [
    ([0.0, 1.0], [[1.0]]), ([0.0, 0.0], [[1.0], [2.0]]), ([1.0, 0.0], [[1.0], [2.0]]),
    ([0.0, 1.0], [1.0, 2.0])])
def test_invalid_input_is_refused(t, q):
    with pytest.raises(DataError, match='cannot differentiate'):
        differentiate(t, q)
