"""What an effect is worth, block by block, and how sure that is."""

from gravity_comp_ros.evaluation.gain import (
    gain, gain_in_few_blocks, gain_of_fast_motion, within_standard_error)
import numpy as np
import pytest


def test_one_wild_stretch_does_not_outweigh_all_others():
    before = np.full((50, 1), 10.0)
    after = np.full((50, 1), 5.0) + np.linspace(0.0, 0.1, 50)[:, None]
    after[7] = 300.0
    assert gain(before, after, tests=100.0).p < 0.01
    assert after.sum() > before.sum()


def test_no_gain_has_no_small_p_and_tests_count():
    rng = np.random.default_rng(4)
    before = rng.chisquare(50, size=(60, 1))
    after = before * np.exp(rng.normal(0.0, 0.1, size=(60, 1)))
    assert gain(before, after, tests=1.0).p > 0.001
    surely = before * 0.9 * np.exp(rng.normal(0.0, 0.1, size=(60, 1)))
    once, often = (gain(before, surely, tests=count) for count in (1.0, 50.0))
    assert often.p == pytest.approx(50.0 * once.p)
    assert once.share == pytest.approx(0.1, abs=0.05)


def test_within_one_standard_error_is_not_worse():
    rng = np.random.default_rng(5)
    errors = rng.chisquare(50, size=(60, 1))
    assert within_standard_error(errors, errors)
    assert within_standard_error(errors, errors * 0.5)
    assert not within_standard_error(errors, errors * np.exp(rng.normal(0.2, 0.1, size=(60, 1))))


def test_what_few_blocks_have_is_found_where_the_others_lose_little():
    rng = np.random.default_rng(6)
    before = rng.chisquare(50, size=(60, 1))
    after = before * np.exp(rng.normal(0.01, 0.02, size=(60, 1)))
    after[:6] = 0.05 * before[:6]
    assert gain(before, after, tests=1.0).p > 1e-3
    assert gain_in_few_blocks(before, after, tests=1.0).p < 1e-9


def test_quiet_blocks_do_not_hide_a_torque_of_fast_motion():
    rng = np.random.default_rng(7)
    # A quarter of the blocks is fast; in the quiet ones a row of inertia costs more than it
    # brings, in proportion to how little error there is.
    before = np.where(np.arange(80) % 4 == 0, 1000.0, 1.0)[:, None]
    lost = np.exp(rng.normal(0.4, 1.2, size=(80, 1)))
    after = np.where(before > 10.0, 0.1 * before, lost * before)
    assert gain_in_few_blocks(before, after, tests=1.0).p > 1e-3
    seen = gain_of_fast_motion(before, after, tests=2.0)
    assert seen.p < 1e-9 and seen.share > 0.85
    assert seen.p == pytest.approx(2.0 * gain_of_fast_motion(before, after, tests=1.0).p)


def test_one_loud_block_is_no_evidence_of_motion_where_most_lose():
    before, after = np.ones((40, 1)), np.full((40, 1), 1.2)
    before[3], after[3] = 1e4, 1.0
    assert gain_of_fast_motion(before, after, tests=1.0).share > 0.9
    before[3], after[3] = 100.0, 1.0
    assert gain_of_fast_motion(before, after, tests=1.0).p == 1.0


def test_chance_alone_gives_no_small_p_of_motion():
    smallest = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        before = rng.chisquare(20, size=(60, 1))
        after = before * np.exp(rng.normal(0.0, 0.1, size=(60, 1)))
        smallest.append(gain_of_fast_motion(before, after, tests=1.0).p)
    # p is right to within what 200 tries can show.
    assert np.mean(np.array(smallest) < 0.05) < 0.1 and min(smallest) > 1e-4
