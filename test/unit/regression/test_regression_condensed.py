"""Fast recordings are averaged before columns are computed."""

from dataclasses import replace

from bench.shared.regression_cases import motion_of_joints
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.regression.condensed import condensed
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.problem import Problem
import numpy as np
import pytest

OPTIONS = EngineOptions()
ALL = replace(OPTIONS, row_samples=10 ** 6, max_samples=10 ** 9)


def recording(rate, seconds=30.0):
    """Return two joints with gravity, Coulomb friction of 2 N·m and noise at some rate, in Hz."""
    samples = concatenate(motion_of_joints(2, 3, seconds, rate))
    rng = np.random.default_rng(1)
    tau = np.column_stack([10.0 * np.sin(samples.q[:, 0]), 4.0 * np.cos(samples.q[:, 1])])
    tau += 2.0 * np.sign(samples.qd) + 0.1 * rng.standard_normal(tau.shape)
    return replace(samples, tau=tau)


def test_a_slow_recording_is_as_it_was():
    samples = recording(100.0)
    means = condensed(samples, np.ones(len(samples), dtype=bool), OPTIONS)
    assert means.samples is samples and len(means.group) == len(samples)


def test_rows_keep_the_means_of_all_samples():
    samples = recording(1000.0)
    problem = Problem.of(samples)
    whole = Problem.of(samples, options=ALL)
    assert len(problem.samples) == pytest.approx(len(samples) / 10, rel=0.01)
    assert len(whole.samples) == len(samples)
    assert problem.n_measured.sum() == len(samples)
    for n in range(2):
        here = np.bincount(problem.row_of, samples.tau[problem.used, n]) / problem.n_measured
        np.testing.assert_allclose(problem.y[:, n], here)


def test_a_long_recording_has_fewer_samples_in_a_row():
    samples = recording(100.0)
    for most, each in ((6000, 10), (3000, 5), (100, 1)):
        problem = Problem.of(samples, options=replace(OPTIONS, max_samples=most))
        assert len(problem.samples) == pytest.approx(600 * each, rel=0.01)
        assert problem.rows.n_rows == pytest.approx(600, abs=2)


def test_samples_that_are_not_used_are_in_no_row():
    samples = recording(1000.0)
    use = samples.t % 7.0 < 4.0
    problem = Problem.of(samples, use)
    assert use[problem.used].all() and len(problem.used) > 0.99 * use.sum()


def test_a_model_of_means_is_that_of_all_samples():
    samples = recording(1000.0)
    coarse, fine = (fit(samples, FitOptions(engine=each)).model for each in (OPTIONS, ALL))
    names = {effect.target for effect in fine.fitted.effects}
    assert {'coulomb_friction:j0', 'coulomb_friction:j1'} <= names
    assert {effect.target for effect in coarse.fitted.effects} == names
    np.testing.assert_allclose(coarse.residual_std, fine.residual_std, rtol=0.02)
    change = predict_torque(coarse, samples) - predict_torque(fine, samples)
    assert np.abs(change).max() < 0.02
