"""Rows of the regression: means, blocks, folds and gaps; and the noise of their residual."""

from dataclasses import replace

from bench.shared.regression_cases import motion_of_joints, OwnGravity, with_torque
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.motion_direction import presliding_state
from gravity_comp_ros.effects.predict import predict_torque
from gravity_comp_ros.effects.registry import known_effect
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.regression.linear import Linear
from gravity_comp_ros.regression.noise import variance_by_motion
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.rows import condensed, N_FOLDS, rows_of
from hypothesis import given, strategies as st
import numpy as np
import pytest

OPTIONS = EngineOptions()


def run_of(t, values=None):
    """Return one run of one joint that moves by 1 rad/s."""
    t = np.asarray(t, dtype=float)
    values = np.zeros(len(t)) if values is None else values
    column = np.asarray(values, dtype=float)[:, None]
    return JointSamples.single_run(('a',), t, t[:, None] - t[0], column, column)


@pytest.mark.parametrize('rate', [30.0, 125.0, 1000.0])
def test_rounding_of_the_stamps_does_not_change_the_rows(rate):
    number = np.arange(int(4.0 * rate))
    counts = [rows_of(run_of(t), OPTIONS).count for t in (
        number / rate, number * (1.0 / rate), 1e5 + number / rate)]
    for count in counts:
        np.testing.assert_array_equal(count, counts[0])
    assert len(counts[0]) == 40


def test_an_arm_at_rest_has_one_row_for_ten_seconds():
    t = np.arange(2000) / 50.0
    q = np.where(t < 2.0, t, np.where(t < 37.0, 2.0, t - 35.0))[:, None]
    rows = rows_of(JointSamples.single_run(('a',), t, q, 0.0 * q, q), OPTIONS)
    # 20 rows of motion, four of a rest of 35 s, 30 of motion.
    assert rows.n_rows == 54
    np.testing.assert_array_equal(np.sort(rows.count)[-4:], [250, 500, 500, 500])
    assert rows.weights.max() == 1.0 and rows.count.sum() == len(t)


def test_a_slow_recording_has_a_row_for_each_sample():
    t = np.arange(50) * 0.25
    rows = rows_of(run_of(t), OPTIONS)
    assert rows.n_rows == 50 and (rows.count == 1).all()
    values = np.random.default_rng(0).normal(size=(50, 2))
    np.testing.assert_array_equal(rows.mean(values), values)
    # Long recordings have longer rows.
    rows = rows_of(run_of(np.arange(40000) / 20), EngineOptions(max_rows=500))
    assert 450 < rows.n_rows <= 501


def test_no_row_has_samples_of_two_runs_or_of_both_sides_of_a_gap():
    one = run_of(np.arange(13) / 50)
    two = run_of(5.0 + np.r_[np.arange(7), 207 + np.arange(6)] / 50)
    samples = concatenate([one, two])
    rows = rows_of(samples, OPTIONS)
    np.testing.assert_array_equal(rows.count, [5, 5, 3, 5, 2, 3, 3])
    np.testing.assert_array_equal(rows.run, [0, 0, 0, 1, 1, 1, 1])
    np.testing.assert_allclose(rows.mean(samples.t)[3:], 5.0 + rows.t[3:])
    # A row with 2 of the usual 3 samples has two thirds of the weight.
    np.testing.assert_allclose(rows.weights, [1, 1, 1, 1, 2 / 3, 1, 1])
    # The gap of 4 s is two blocks of 2 s.
    assert len(np.unique(rows.block)) == 3


def test_unused_samples_are_in_no_row():
    samples = run_of(np.arange(20) / 50, np.arange(20))
    use = np.arange(20) % 5 != 0
    rows = rows_of(samples, OPTIONS, use)
    np.testing.assert_allclose(rows.mean(samples.tau)[:, 0], [2.5, 7.5, 12.5, 17.5])
    with pytest.raises(FitError, match='no samples'):
        rows_of(samples, OPTIONS, np.zeros(20, dtype=bool))


@given(st.integers(0, 10 ** 6), st.integers(1, 7), st.sampled_from([0.01, 0.1, 0.5]))
def test_columns_in_batches_are_the_means_of_all(seed, runs, seconds):
    rng = np.random.default_rng(seed)
    samples = concatenate([run_of(np.cumsum(rng.uniform(0.002, 0.2, rng.integers(1, 4000))))
                           for _ in range(runs)])
    use = rng.random(samples.n_samples) < 0.8
    if not use.any():
        return
    rows = rows_of(samples, EngineOptions(row_seconds=seconds), use)
    values = rng.normal(size=(samples.n_samples, 2, 3))
    mean = rows.mean(values)
    np.testing.assert_allclose(np.einsum('r,rnk->nk', rows.count.astype(float), mean),
                               values[use].sum(axis=0), atol=1e-8)
    # A block, and a fold of ten seconds, has rows of one run.
    assert all(len(np.unique(rows.run[rows.block == k])) == 1 for k in np.unique(rows.block))


def test_blocks_are_two_seconds_of_one_run():
    rows = rows_of(concatenate([run_of(np.arange(250) / 50), run_of(np.arange(250) / 50)]),
                   OPTIONS)
    np.testing.assert_array_equal(np.bincount(rows.block), [20, 20, 10, 20, 20, 10])
    # Short recordings have every fold.
    rows = rows_of(run_of(np.arange(500) / 50), OPTIONS)
    np.testing.assert_allclose(np.bincount(rows.fold), [20] * 5, atol=1)


def test_folds_are_whole_runs_if_there_are_enough():
    few = rows_of(concatenate([run_of(np.arange(1500) / 50)] * 2), OPTIONS)
    assert set(few.fold) == set(range(N_FOLDS))
    changes = np.flatnonzero(np.diff(few.fold) | np.diff(few.run))
    assert np.diff(changes).min() >= 99       # 10 s of rows of 0.1 s
    hundred = rows_of(concatenate([run_of(np.arange(100) / 50)] * 7), OPTIONS)
    np.testing.assert_array_equal(hundred.fold, hundred.run % N_FOLDS)


def test_poses_without_motion_between_them_have_rows_of_their_own():
    still = run_of(np.arange(400) / 20)
    q = still.q.copy()
    q[200:, 0] += np.arange(200) * 0.5
    rows = rows_of(replace(still, q=q), EngineOptions(max_rows=20))
    assert (rows.count[-200:] == 1).all() and (rows.count[:-200] > 10).all()


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
    # A long recording has fewer samples in a row.
    for most, each in ((6000, 10), (3000, 5), (100, 1)):
        problem = Problem.of(samples, options=replace(OPTIONS, max_samples=most))
        assert len(problem.samples) == pytest.approx(600 * each, rel=0.01)
        assert problem.rows.n_rows == pytest.approx(600, abs=2)


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
    # Samples that are not used are in no row.
    use = samples.t % 7.0 < 4.0
    problem = Problem.of(samples, use)
    assert use[problem.used].all() and len(problem.used) > 0.99 * use.sum()


def test_a_model_of_means_is_that_of_all_samples():
    samples = recording(500.0, 15.0)
    coarse, fine = (fit(samples, FitOptions(engine=each)).model for each in (OPTIONS, ALL))
    names = {effect.target for effect in fine.fitted.effects}
    assert {'coulomb_friction:j0', 'coulomb_friction:j1'} <= names
    assert {effect.target for effect in coarse.fitted.effects} == names
    np.testing.assert_allclose(coarse.residual_std, fine.residual_std, rtol=0.02)
    change = predict_torque(coarse, samples) - predict_torque(fine, samples)
    assert np.abs(change).max() < 0.02


ANGLE, SPEED = 2e-5, 1e-3


def measured(seed, torque):
    """Return samples at 50 Hz, true and with noisy angles and speeds."""
    rng, runs = np.random.default_rng(seed), motion_of_joints(1, seed, rate=50.0)
    true = with_torque(runs, torque, seed, noise=1e-3)
    noisy = JointSamples(true.names, true.t, true.q + ANGLE * rng.standard_normal(true.q.shape),
                         true.qd + SPEED * rng.standard_normal(true.q.shape), true.tau,
                         true.runs, true.run_labels)
    return true, noisy


def fitted(samples, *terms):
    """Return the problem of samples linearised with some terms, (name, setting)."""
    problem, shared = Problem.of(samples), OwnGravity(np.array([4.0, -1.0]))
    factory = problem.factory(shared)
    return Linear.at(problem, shared, factory, tuple(
        factory.term(known_effect(name), 0, setting) for name, setting in terms), problem.weights)


def test_viscous_friction_by_hand():
    # The mean of five samples: (F sigma)^2 / 5.
    _, samples = measured(0, lambda q, qd, t: 4.0 * np.sin(q) - np.cos(q) + 2.0 * qd)
    fit = fitted(samples, ('viscous_friction', {}))
    variance = variance_by_motion(fit.posterior, fit.factory)
    assert variance.mean() == pytest.approx((2.0 * SPEED) ** 2 / 5.0, rel=0.1)


def test_rows_with_a_reversal_have_the_error_of_friction():
    def torque(q, qd, t):
        runs = np.split(q[:, 0], np.flatnonzero(np.diff(t) < 0.0) + 1)
        return (4.0 * np.sin(q) - np.cos(q) + np.concatenate(
            [presliding_state(run, 5e-5) for run in runs])[:, None])

    true, samples = measured(0, torque)
    fit = fitted(samples, ('coulomb_friction', {'distance': 5e-5}))
    std = np.sqrt(variance_by_motion(fit.posterior, fit.factory))[:, 0]
    term, = fit.posterior.terms
    exact = term.effect.columns(Problem.of(true).motion, 0, term.setting)
    error = (term.columns - fit.problem.rows.mean(exact))[:, 0]
    uncertain = std > 0.02
    assert 0.005 < uncertain.mean() < 0.1
    assert np.abs(error[~uncertain]).max() < 0.1
    # The path without encoder noise leads by about its standard deviation, which no draw shows.
    ratio = np.sqrt((error[uncertain] ** 2).mean() / (std[uncertain] ** 2).mean())
    assert 0.4 < ratio < 3.0, ratio
