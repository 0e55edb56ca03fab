"""Gain of an effect, block by block, and its significance."""

from gravity_comp_ros.evaluation.gain import gain
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
