"""Sample buffer: bounded, in order of time, with diverse instead of recent poses."""

from gravity_comp_ros.data.sample_buffer import SampleRing
from gravity_comp_ros.errors import DataError, OptionError
from hypothesis import given, strategies as st
import numpy as np
import pytest


def offer(ring, t, q, qd=0.0, tau=0.0):
    ring.offer(t, np.full(1, q), np.full(1, qd), np.full(1, tau))


def test_all_samples_are_kept_until_it_is_full():
    ring = SampleRing(['j'], 3)
    for k in range(3):
        offer(ring, k, 0.1 * k, tau=k)
    samples = ring.samples()
    np.testing.assert_array_equal(samples.t, [0, 1, 2])
    np.testing.assert_array_equal(samples.tau[:, 0], [0, 1, 2])
    assert samples.n_runs == 1


def test_the_older_of_the_closest_pair_is_removed():
    ring = SampleRing(['j'], 3)
    for t, q in enumerate([0.0, 0.1, 1.0]):
        offer(ring, t, q)
    offer(ring, 3, 2.0)
    np.testing.assert_allclose(ring.samples().q[:, 0], [0.1, 1.0, 2.0])
    offer(ring, 4, 1.9)
    np.testing.assert_allclose(ring.samples().q[:, 0], [0.1, 1.0, 1.9])


def test_both_directions_of_a_pose_are_kept():
    ring = SampleRing(['j'], 2)
    for t, (q, qd) in enumerate([(0.5, 0.1), (0.5, -0.1), (0.501, 0.1), (0.501, -0.1)]):
        offer(ring, t, q, qd)
    np.testing.assert_array_equal(np.sort(ring.samples().qd[:, 0]), [-0.1, 0.1])


@pytest.mark.parametrize('noise', [0.0, 1e-4, 3e-3])
def test_an_hour_at_rest_does_not_replace_the_motion(noise):
    rng = np.random.default_rng(3)
    ring = SampleRing([f'j{k}' for k in range(7)], 300)
    t = np.arange(500) / 5.0
    motion = np.sin(np.outer(t, 0.05 * np.arange(1, 8)) + np.arange(7))
    for k in range(500):
        ring.offer(t[k], motion[k], np.zeros(7), np.zeros(7))
    before = ring.samples().q
    for k in range(18000):
        ring.offer(100 + 0.2 * k, motion[-1] + noise * rng.standard_normal(7),
                   np.zeros(7), np.zeros(7))
    after = ring.samples().q
    assert len(ring) == 300
    survivors = sum((np.abs(before - row).max(axis=1) < 1e-12).any() for row in after)
    assert survivors >= 295 if noise < 1e-3 else survivors >= 250
    still = ring.span()
    assert np.all(still > 0.95 * (motion.max(axis=0) - motion.min(axis=0)))


def test_a_slow_creep_is_kept_as_many_samples():
    ring = SampleRing(['j'], 100)
    for k in range(1000):
        offer(ring, 0.2 * k, 2e-4 * k)
    assert ring.span()[0] > 0.18
    assert len(ring) == 100


def test_decreasing_time_starts_a_new_run():
    ring = SampleRing(['j'], 10)
    for t, q in [(5.0, 0.0), (6.0, 0.1), (1.0, 0.2), (2.0, 0.3)]:
        offer(ring, t, q)
    samples = ring.samples()
    np.testing.assert_array_equal(samples.runs, [0, 0, 1, 1])
    np.testing.assert_array_equal(samples.t, [5, 6, 1, 2])


def test_span():
    ring = SampleRing(['a', 'b'], 10)
    assert len(ring.samples()) == 0 and not ring.span().any()
    ring.offer(0.0, np.array([0.0, 1.0]), np.zeros(2), np.zeros(2))
    ring.offer(1.0, np.array([0.5, 1.05]), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(ring.span(), [0.5, 0.05])


def test_bad_input_is_refused():
    with pytest.raises(OptionError, match='at least 2'):
        SampleRing(['j'], 1)
    ring = SampleRing(['j'], 4)
    with pytest.raises(DataError, match='not finite'):
        offer(ring, 0.0, np.nan)
    assert len(ring) == 0


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-0.1, 0.1)), max_size=60),
       st.integers(2, 12))
def test_the_buffer_is_bounded_and_its_neighbours_are_correct(poses, capacity):
    ring = SampleRing(['j'], capacity)
    for t, (q, qd) in enumerate(poses):
        offer(ring, float(t), q, qd, tau=float(t))
        assert len(ring) <= capacity
    samples = ring.samples()
    # All values of a sample are those offered at its time.
    for t, q, qd, tau in zip(samples.t, samples.q, samples.qd, samples.tau):
        assert (q[0], qd[0], tau[0]) == (*poses[int(t)], t)
    n = len(ring)
    if n > 1:
        gaps = ring._features[:n, None] - ring._features[None, :n]
        distances = np.einsum('ijk,ijk->ij', gaps, gaps)
        np.fill_diagonal(distances, np.inf)
        np.testing.assert_allclose(ring._near[:n], distances.min(axis=1), rtol=1e-12)
        np.testing.assert_array_equal(
            distances[np.arange(n), ring._nearest[:n]], ring._near[:n])


def test_accelerations_are_kept_if_most_are_known():
    ring = SampleRing(['j'], 100)
    for k in range(20):
        value = np.full(1, 0.1 * k)
        ring.offer(float(k), value, value, value, None if k == 3 else 2.0 * value)
    qdd = ring.samples().qdd[:, 0]
    assert qdd[3] == 0.0
    np.testing.assert_allclose(np.delete(qdd, 3), 0.2 * np.delete(np.arange(20), 3))
    for k in range(20, 25):
        ring.offer(float(k), np.full(1, 0.1 * k), np.zeros(1), np.zeros(1))
    assert ring.samples().qdd is None


def test_a_sample_that_replaces_another_has_its_own_acceleration():
    ring = SampleRing(['j'], 10)
    ring.offer(0.0, np.zeros(1), np.zeros(1), np.zeros(1), np.full(1, 0.1))
    ring.offer(1.0, np.full(1, 1e-5), np.zeros(1), np.zeros(1), np.full(1, 0.3))
    assert ring.samples().qdd.tolist() == [[0.3]]
