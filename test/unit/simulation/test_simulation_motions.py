"""Motions: the paper's formulas, exact derivatives, limits for all time."""

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.motions import MultisineOptions
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

LOW, HIGH, SPEED = np.array([-1.0, -2.0, 0.0]), np.array([1.0, 0.5, 3.0]), np.full(3, 1.5)


def test_eq15_as_printed():
    motion = motions.eq15()
    t = np.arange(200) / 10
    pi = np.pi
    printed = np.stack([
        1.4 * np.sin(0.25 * pi * t), 1.4 * np.sin(0.2 * pi * t), 1.8 * np.sin(0.167 * pi * t),
        1.3 * np.sin(0.25 * pi * t - 0.167 * pi), 3 * np.sin(0.33 * pi * t),
        2 * np.sin(0.167 * pi * t), 3 * np.sin(0.2 * pi * t)], axis=1)
    np.testing.assert_allclose(motion.q, printed, atol=1e-12)
    np.testing.assert_allclose(motion.t, t)


def test_eq17_as_printed():
    motion = motions.eq17()
    t = np.arange(500) / 5
    sin, cos = np.sin, np.cos
    printed = np.stack([
        0.65 * sin(0.1 * t + 1.5), 0.25 * (cos(0.2 * t + 0.2) - cos(0.2)) + 0.5,
        0.5 * (sin(0.2 * t + 0.3) - sin(0.3)), 0.9 * (sin(0.125 * t + 0.2) - sin(0.2)) + 0.25,
        0.25 * sin(0.2 * t), 0.4 * (cos(0.25 * t + 0.4) - cos(0.4)) + 0.25,
        0.25 * (sin(0.2 * t + 0.4) - sin(0.4))], axis=1)
    np.testing.assert_allclose(motion.q, printed, atol=1e-12)
    np.testing.assert_allclose(motion.t, t)


def all_motions():
    return [motions.eq15(), motions.eq17(),
            motions.multisine(LOW, HIGH, SPEED, 5, MultisineOptions(ramp=20.0))]


@pytest.mark.parametrize('motion', all_motions(), ids=lambda m: m.name)
def test_speed_and_acceleration_are_the_derivatives(motion):
    step = 1e-4
    t = motion.t + 0.037  # not at the end of the ramp, where the third derivative jumps
    before, after, here = (motion.path(t + dt) for dt in (-step, step, 0.0))
    for order in (0, 1):
        numeric = (after[order] - before[order]) / (2 * step)
        np.testing.assert_allclose(here[order + 1], numeric, atol=2e-7)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), max_speed=st.floats(0.01, 3.0),
       n_sines=st.integers(1, 8), band=st.floats(0.02, 1.0))
def test_multisine_stays_within_every_limit_for_all_time(seed, max_speed, n_sines, band):
    options = MultisineOptions(max_speed=max_speed, n_sines=n_sines, band=band)
    motion = motions.multisine(LOW, HIGH, SPEED, seed, options, duration=250.0, rate=97.0)
    assert (np.abs(motion.qd) <= np.minimum(max_speed, SPEED) + 1e-12).all()
    assert (motion.q >= LOW).all() and (motion.q <= HIGH).all()
    # Each joint reaches one of its bounds.
    fast = np.abs(motion.qd).max(axis=0) > 0.98 * np.minimum(max_speed, SPEED)
    wide = np.ptp(motion.q, axis=0) > 0.9 * (HIGH - LOW)
    assert (fast | wide).all()


def test_multisine_starts_at_rest_and_continues_as_the_same_motion():
    motion = motions.multisine(LOW, HIGH, SPEED, 7)
    assert not motion.qd[0].any() and not motion.qdd[0].any()
    later = motions.multisine(LOW, HIGH, SPEED, 7, duration=50.0, rate=10.0, start=40.0)
    np.testing.assert_allclose(later.q[:120:2], motion.q[200:260], atol=1e-12)
    other = motions.multisine(LOW, HIGH, SPEED, 8)
    assert np.abs(other.q - motion.q).max() > 0.1


def test_random_poses_are_seeded_at_rest_and_spread_over_the_limits():
    motion = motions.random_poses(LOW, HIGH, 4000, seed=3, period=2.0, start=10.0)
    assert not motion.qd.any() and not motion.qdd.any()
    assert (motion.q >= LOW).all() and (motion.q <= HIGH).all()
    np.testing.assert_allclose(motion.q.mean(axis=0), (LOW + HIGH) / 2, atol=0.06)
    np.testing.assert_allclose(np.diff(motion.t), 2.0)
    np.testing.assert_array_equal(
        motion.q, motions.random_poses(LOW, HIGH, 4000, seed=3).q)
    np.testing.assert_array_equal(motion.path(motion.t + 1.99)[0], motion.q)


def test_a_motion_without_a_sample_is_refused():
    with pytest.raises(OptionError, match='no sample'):
        motions.eq15(duration=0.01)
