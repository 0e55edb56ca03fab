"""Sample buffer: bounded, in order of time, with diverse instead of recent poses."""

from gravity_comp_ros.data.sample_buffer import SampleBuffer
from gravity_comp_ros.errors import DataError, OptionError
from hypothesis import given, strategies as st
import numpy as np
import pytest


def offer(buffer, t, q, qd=0.0, tau=0.0):
    buffer.offer(t, np.full(1, q), np.full(1, qd), np.full(1, tau))


def test_all_samples_are_kept_until_it_is_full():
    buffer = SampleBuffer(['j'], 3)
    for k in range(3):
        offer(buffer, k, 0.1 * k, tau=k)
    samples = buffer.samples()
    np.testing.assert_array_equal(samples.t, [0, 1, 2])
    np.testing.assert_array_equal(samples.tau[:, 0], [0, 1, 2])
    assert samples.n_runs == 1


def test_the_newest_sample_of_a_cell_is_kept_and_cells_grow_in_a_full_buffer():
    buffer = SampleBuffer(['j'], 3)
    for t, q in enumerate([0.1, 0.1004, 0.102, 1.0]):
        offer(buffer, t, q)
    np.testing.assert_allclose(buffer.samples().q[:, 0], [0.1004, 0.102, 1.0])
    offer(buffer, 4, 2.0)
    np.testing.assert_allclose(buffer.samples().q[:, 0], [0.102, 1.0, 2.0])
    offer(buffer, 5, 1.001)
    np.testing.assert_allclose(buffer.samples().q[:, 0], [0.102, 2.0, 1.001])


def test_held_out_samples_have_cells_of_their_own():
    buffer = SampleBuffer(['j'], 10)
    for t, is_held_out in [(1.0, False), (2.0, True), (3.0, False), (4.0, True), (0.0, True)]:
        buffer.offer(t, np.zeros(1), np.zeros(1), np.full(1, t), is_held_out=is_held_out)
    assert buffer.samples().t.tolist() == [3.0, 0.0] and buffer.samples().n_runs == 2
    assert buffer.held_out().tolist() == [False, True]
    copy = buffer.snapshot()
    offer(buffer, 1.0, 0.5)
    assert len(copy) == 2 and copy.samples().t.tolist() == [3.0, 0.0]


def test_both_directions_of_a_pose_are_kept():
    buffer = SampleBuffer(['j'], 2)
    for t, (q, qd) in enumerate([(0.5, 0.1), (0.5, -0.1), (0.501, 0.1), (0.501, -0.1)]):
        offer(buffer, t, q, qd)
    np.testing.assert_array_equal(np.sort(buffer.samples().qd[:, 0]), [-0.1, 0.1])


@pytest.mark.parametrize('noise', [0.0, 1e-4, 3e-3])
def test_an_hour_at_rest_does_not_replace_the_motion(noise):
    rng = np.random.default_rng(3)
    buffer = SampleBuffer([f'j{k}' for k in range(7)], 300)
    t = np.arange(500) / 5.0
    motion = np.sin(np.outer(t, 0.05 * np.arange(1, 8)) + np.arange(7))
    for k in range(500):
        buffer.offer(t[k], motion[k], np.zeros(7), np.zeros(7))
    before = buffer.samples().q
    for k in range(18000):
        buffer.offer(100 + 0.2 * k, motion[-1] + noise * rng.standard_normal(7),
                     np.zeros(7), np.zeros(7))
    after = buffer.samples().q
    assert 150 <= len(buffer) <= 300
    survivors = sum((np.abs(before - row).max(axis=1) < 1e-12).any() for row in after)
    assert survivors >= len(before) - 5 if noise < 1e-3 else survivors >= 0.8 * len(before)
    still = buffer.span()
    assert np.all(still > 0.95 * (motion.max(axis=0) - motion.min(axis=0)))


def test_a_slow_creep_is_kept_as_many_samples():
    buffer = SampleBuffer(['j'], 100)
    for k in range(1000):
        offer(buffer, 0.2 * k, 2e-4 * k)
    assert buffer.span()[0] > 0.18
    assert 50 <= len(buffer) <= 100


def test_decreasing_time_starts_a_new_run():
    buffer = SampleBuffer(['j'], 10)
    for t, q in [(5.0, 0.0), (6.0, 0.1), (1.0, 0.2), (2.0, 0.3)]:
        offer(buffer, t, q)
    samples = buffer.samples()
    np.testing.assert_array_equal(samples.runs, [0, 0, 1, 1])
    np.testing.assert_array_equal(samples.t, [5, 6, 1, 2])


def test_span():
    buffer = SampleBuffer(['a', 'b'], 10)
    assert len(buffer.samples()) == 0 and not buffer.span().any()
    buffer.offer(0.0, np.array([0.0, 1.0]), np.zeros(2), np.zeros(2))
    buffer.offer(1.0, np.array([0.5, 1.05]), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(buffer.span(), [0.5, 0.05])


def test_bad_input_is_refused():
    with pytest.raises(OptionError, match='at least 2'):
        SampleBuffer(['j'], 1)
    buffer = SampleBuffer(['j'], 4)
    with pytest.raises(DataError, match='not finite'):
        offer(buffer, 0.0, np.nan)
    assert len(buffer) == 0


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-0.1, 0.1)), max_size=60),
       st.integers(2, 12))
def test_the_buffer_is_bounded_and_keeps_one_sample_of_each_cell(poses, capacity):
    buffer = SampleBuffer(['j'], capacity)
    for t, (q, qd) in enumerate(poses):
        offer(buffer, float(t), q, qd, tau=float(t))
        assert len(buffer) <= capacity
    samples = buffer.samples()
    # All values of a sample are those offered at its time.
    for t, q, qd, tau in zip(samples.t, samples.q, samples.qd, samples.tau):
        assert (q[0], qd[0], tau[0]) == (*poses[int(t)], t)
    cells = buffer._cells(buffer._rows[buffer._by_time()])
    assert len(np.unique(cells, axis=0)) == len(buffer) == len(samples)


def test_accelerations_are_kept_if_most_are_known():
    buffer = SampleBuffer(['j'], 100)
    for k in range(20):
        value = np.full(1, 0.1 * k)
        buffer.offer(float(k), value, value, value, None if k == 3 else 2.0 * value)
    qdd = buffer.samples().qdd[:, 0]
    assert qdd[3] == 0.0
    np.testing.assert_allclose(np.delete(qdd, 3), 0.2 * np.delete(np.arange(20), 3))
    for k in range(20, 25):
        buffer.offer(float(k), np.full(1, 0.1 * k), np.zeros(1), np.zeros(1))
    assert buffer.samples().qdd is None


def test_a_sample_that_replaces_another_has_its_own_acceleration():
    buffer = SampleBuffer(['j'], 10)
    buffer.offer(0.0, np.zeros(1), np.zeros(1), np.zeros(1), np.full(1, 0.1))
    buffer.offer(1.0, np.full(1, 1e-5), np.zeros(1), np.zeros(1), np.full(1, 0.3))
    assert buffer.samples().qdd.tolist() == [[0.3]]
