"""Condensed samples: means over short stretches of consecutive samples."""

from gravity_comp_ros.data.condense import condense, CondenseOptions
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import OptionError
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest


def walk(seed, count, step, runs=1):
    """Return random walks of two joints."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(runs):
        q = np.cumsum(step * rng.normal(size=(count, 2)), axis=0)
        parts.append(JointSamples.single_run(('a', 'b'), 0.1 * np.arange(count), q,
                                             rng.normal(size=(count, 2)),
                                             rng.normal(size=(count, 2))))
    return concatenate(parts)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1000), st.integers(1, 400), st.sampled_from([0.0, 1e-4, 1e-2, 0.3]),
       st.integers(1, 3), st.integers(10, 200))
def test_stretches_are_consecutive_samples_of_a_run(seed, count, step, runs, most):
    samples = walk(seed, count, step, runs)
    stretches = condense(samples, CondenseOptions(max_stretches=most))
    assert 1 <= len(stretches.first) <= most + 1
    assert (stretches.count >= 1).all()
    assert (np.diff(stretches.first) >= stretches.count[:-1]).all()
    for first, size in zip(stretches.first, stretches.count):
        own = slice(first, first + size)
        assert len(set(samples.runs[own].tolist())) == 1
    means = stretches.mean(samples.tau)
    for k in (0, len(stretches.first) - 1):
        own = slice(stretches.first[k], stretches.first[k] + stretches.count[k])
        np.testing.assert_allclose(means[k], samples.tau[own].mean(axis=0), atol=1e-12)
    assert stretches.samples(samples).n_samples == len(stretches.first)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([1e-4, 1e-3]))
def test_means_are_exact_for_linear_terms(seed, step):
    samples = walk(seed, 300, step)
    stretches = condense(samples)
    mixed = 2.0 * samples.tau - 3.0 * samples.qd + 1.0
    np.testing.assert_allclose(stretches.mean(mixed), 2.0 * stretches.mean(samples.tau)
                               - 3.0 * stretches.mean(samples.qd) + 1.0, atol=1e-9)


def test_an_arm_at_rest_is_one_stretch():
    q = np.concatenate([np.linspace(0, 1, 50), np.full(500, 1.0)])[:, None]
    samples = JointSamples.single_run(('a',), 0.1 * np.arange(550), q, np.zeros_like(q), q)
    assert len(condense(samples).first) <= 51


@pytest.mark.parametrize('make', [lambda: CondenseOptions(max_stretches=1),
                                  lambda: CondenseOptions(max_travel=0.0),
                                  lambda: CondenseOptions(min_travel=1.0)])
def test_options_out_of_range(make):
    with pytest.raises(OptionError, match='condense'):
        make()
