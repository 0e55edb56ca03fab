"""Sample buffer: bounded, in order of time, with diverse instead of recent poses."""

from gravity_comp_ros.node.sample_buffer import SampleBuffer
from hypothesis import given, strategies as st
import numpy as np
import pytest


def offer(buffer, sample, q, qd=0.0, **options):
    buffer.offer(np.full(1, q), np.full(1, qd), sample, **options)


def test_the_newest_sample_of_a_cell_is_kept_and_cells_grow_in_a_full_buffer():
    buffer = SampleBuffer(3)
    for q in (0.1, 0.1004, 0.102, 1.0):
        offer(buffer, q, q)
    assert buffer.samples() == [0.1004, 0.102, 1.0]
    offer(buffer, 2.0, 2.0)
    assert buffer.samples() == [0.102, 1.0, 2.0]
    offer(buffer, 1.001, 1.001)
    assert buffer.samples() == [0.102, 2.0, 1.001]


def test_held_out_samples_have_cells_of_their_own():
    buffer = SampleBuffer(10)
    for k, is_held_out in enumerate((False, True, False, True)):
        offer(buffer, k, 0.0, is_held_out=is_held_out)
    assert buffer.samples() == [2, 3]


def test_both_directions_of_a_pose_are_kept():
    buffer = SampleBuffer(2)
    for q, qd in ((0.5, 0.1), (0.5, -0.1), (0.501, 0.1), (0.501, -0.1)):
        offer(buffer, qd, q, qd)
    assert buffer.samples() == [0.1, -0.1]


@pytest.mark.parametrize('noise', [0.0, 1e-4, 3e-3])
def test_an_hour_at_rest_does_not_replace_the_motion(noise):
    rng, buffer = np.random.default_rng(3), SampleBuffer(300)
    t = np.arange(500) / 5.0
    motion = np.sin(np.outer(t, 0.05 * np.arange(1, 8)) + np.arange(7))
    for q in motion:
        buffer.offer(q, np.zeros(7), q)
    before = np.array(buffer.samples())
    for _ in range(18000):
        q = motion[-1] + noise * rng.standard_normal(7)
        buffer.offer(q, np.zeros(7), q)
    after = np.array(buffer.samples())
    assert 150 <= len(buffer) <= 300
    survivors = sum((np.abs(before - row).max(axis=1) < 1e-12).any() for row in after)
    assert survivors >= len(before) - 5 if noise < 1e-3 else survivors >= 0.8 * len(before)
    assert np.all(np.ptp(after, axis=0) > 0.95 * np.ptp(motion, axis=0))


def test_a_slow_creep_is_kept_as_many_samples():
    buffer = SampleBuffer(100)
    for k in range(1000):
        offer(buffer, 2e-4 * k, 2e-4 * k)
    assert np.ptp(buffer.samples()) > 0.18
    assert 50 <= len(buffer) <= 100


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-0.1, 0.1)), max_size=60),
       st.integers(2, 12))
def test_the_buffer_is_bounded_and_in_order_and_keeps_one_sample_of_each_cell(poses, capacity):
    buffer = SampleBuffer(capacity)
    for k, (q, qd) in enumerate(poses):
        offer(buffer, k, q, qd)
        assert len(buffer) <= capacity and buffer.samples()[-1] == k
    assert buffer.samples() == sorted(buffer.samples())
    cells = [cell.tolist() for cell, _ in buffer._cells.values()]
    assert len({*map(tuple, cells)}) == len(buffer)
