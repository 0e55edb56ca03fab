"""Significance of a decrease of the error, block by block."""

from gravity_comp_ros.evaluation.compare import p_of_decrease
import numpy as np
import pytest


def test_one_block_with_a_large_error_does_not_dominate():
    before = np.full(50, 10.0)
    after = np.full(50, 5.0) + np.linspace(0.0, 0.1, 50)
    after[7] = 300.0
    assert p_of_decrease(before, after, 100.0) < 0.01
    assert after.sum() > before.sum()


def test_p_is_large_without_gain_and_corrected_for_tests():
    rng = np.random.default_rng(4)
    before = rng.chisquare(50, size=60)
    after = before * np.exp(rng.normal(0.0, 0.1, size=60))
    assert p_of_decrease(before, after, 1.0) > 0.001
    improved = before * 0.9 * np.exp(rng.normal(0.0, 0.1, size=60))
    once, often = (p_of_decrease(before, improved, count) for count in (1.0, 50.0))
    assert often == pytest.approx(50.0 * once)
