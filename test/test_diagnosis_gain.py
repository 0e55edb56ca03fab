"""Gain of an effect, block by block, and its significance."""

from gravity_comp_ros.evaluation.gain import (
    gain, gain_in_few_blocks, gain_of_fast_motion, within_standard_error)
import numpy as np
import pytest


def test_one_block_with_a_large_error_does_not_dominate():
    before = np.full((50, 1), 10.0)
    after = np.full((50, 1), 5.0) + np.linspace(0.0, 0.1, 50)[:, None]
    after[7] = 300.0
    assert gain(before, after, tests=100.0).p < 0.01
    assert after.sum() > before.sum()


def test_p_is_large_without_gain_and_corrected_for_tests():
    rng = np.random.default_rng(4)
    before = rng.chisquare(50, size=(60, 1))
    after = before * np.exp(rng.normal(0.0, 0.1, size=(60, 1)))
    assert gain(before, after, tests=1.0).p > 0.001
    improved = before * 0.9 * np.exp(rng.normal(0.0, 0.1, size=(60, 1)))
    once, often = (gain(before, improved, tests=count) for count in (1.0, 50.0))
    assert often.p == pytest.approx(50.0 * once.p)
    assert once.share == pytest.approx(0.1, abs=0.05)


def test_within_one_standard_error_is_not_worse():
    rng = np.random.default_rng(5)
    errors = rng.chisquare(50, size=(60, 1))
    assert within_standard_error(errors, errors)
    assert within_standard_error(errors, errors * 0.5)
    assert not within_standard_error(errors, errors * np.exp(rng.normal(0.2, 0.1, size=(60, 1))))


def test_a_gain_in_few_blocks_is_significant():
    rng = np.random.default_rng(6)
    before = rng.chisquare(50, size=(60, 1))
    after = before * np.exp(rng.normal(0.01, 0.02, size=(60, 1)))
    after[:6] = 0.05 * before[:6]
    assert gain(before, after, tests=1.0).p > 1e-3
    assert gain_in_few_blocks(before, after, tests=1.0).p < 1e-9


def test_slow_blocks_do_not_hide_a_torque_of_fast_motion():
    rng = np.random.default_rng(7)
    # A quarter of the blocks is fast; in the slow ones inertia increases the error, which is
    # small there.
    before = np.where(np.arange(80) % 4 == 0, 1000.0, 1.0)[:, None]
    factor = np.exp(rng.normal(0.4, 1.2, size=(80, 1)))
    after = np.where(before > 10.0, 0.1 * before, factor * before)
    assert gain_in_few_blocks(before, after, tests=1.0).p > 1e-3
    result = gain_of_fast_motion(before, after, tests=2.0)
    assert result.p < 1e-9 and result.share > 0.85
    assert result.p == pytest.approx(2.0 * gain_of_fast_motion(before, after, tests=1.0).p)


def test_one_block_is_no_evidence_of_motion_if_most_get_worse():
    before, after = np.ones((40, 1)), np.full((40, 1), 1.2)
    before[3], after[3] = 1e4, 1.0
    assert gain_of_fast_motion(before, after, tests=1.0).share > 0.9
    before[3], after[3] = 100.0, 1.0
    assert gain_of_fast_motion(before, after, tests=1.0).p == 1.0


def test_random_changes_give_no_small_p_of_motion():
    smallest = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        before = rng.chisquare(20, size=(60, 1))
        after = before * np.exp(rng.normal(0.0, 0.1, size=(60, 1)))
        smallest.append(gain_of_fast_motion(before, after, tests=1.0).p)
    # p is calibrated within the accuracy of 200 trials.
    assert np.mean(np.array(smallest) < 0.05) < 0.1 and min(smallest) > 1e-4
