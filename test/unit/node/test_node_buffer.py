"""Samples of an epoch that is full: in order of time, with diverse instead of recent poses."""

from dataclasses import replace

from bench.shared.node_messages import slow_sample
from gravity_comp_ros.node.epoch import thinned
from hypothesis import given, strategies as st
import numpy as np
import pytest


def sample(t, q, qd=0.0, is_held_out=False):
    q = np.atleast_1d(q)
    return replace(slow_sample(t, q, np.full(len(q), qd), 0.0 * q), is_held_out=is_held_out)


def kept(samples, count):
    """Return the numbers of the samples that are kept."""
    return [each.reading.t for each in thinned(samples, count)]


def test_the_newest_sample_of_a_cell_is_kept_and_held_out_samples_have_their_own():
    poses = (0.1, 0.1004, 0.12, 1.0)
    assert kept([sample(k, q) for k, q in enumerate(poses)], 3) == [1, 2, 3]
    assert kept([sample(k, 0.0, is_held_out=k % 2 == 1) for k in range(4)], 3) == [2, 3]
    both = [sample(k, q, qd) for k, (q, qd) in enumerate(
        ((0.5, 0.1), (0.5, -0.1), (0.501, 0.1), (0.501, -0.1)))]
    assert kept(both, 2) == [2, 3], 'both directions of a pose'


@pytest.mark.parametrize('noise', [0.0, 1e-4, 3e-3])
def test_an_hour_at_rest_does_not_replace_the_motion(noise):
    rng = np.random.default_rng(3)
    t = np.arange(500) / 5.0
    motion = np.sin(np.outer(t, 0.05 * np.arange(1, 8)) + np.arange(7))
    samples = [sample(k, q) for k, q in enumerate(motion)]
    for _ in range(20):
        rest = motion[-1] + noise * rng.standard_normal((900, 7))
        samples = thinned([*samples, *(sample(1000, q) for q in rest)], 600)
    assert len([each for each in samples if each.reading.t < 1000]) >= 250
    after = np.array([each.reading.q for each in samples])
    assert np.all(np.ptp(after, axis=0) > 0.95 * np.ptp(motion, axis=0))


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-0.1, 0.1)), min_size=1, max_size=60),
       st.integers(2, 12))
def test_the_samples_are_few_and_in_order_with_the_newest_one(poses, count):
    few = kept([sample(k, q, qd) for k, (q, qd) in enumerate(poses)], count)
    assert 1 <= len(few) <= count and few == sorted(set(few)) and few[-1] == len(poses) - 1
