"""Evidence of effects: blocks, fits without a fold, and priors of other joints."""

from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.evidence import (
    absorbed, covariance, held_out_errors, joint_rows, largest_group_share, Prior,
    shared_information, solve, with_gravity_columns)
from gravity_comp_ros.diagnosis.options import SelectionOptions, VerdictOptions
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.evaluation.blocks import cut
import numpy as np
import pytest


def recording(lengths=(1000, 600), n_joints=2, seed=0):
    """Return runs with white torque, without repeating structure."""
    rng = np.random.default_rng(seed)
    names = tuple(f'j{k}' for k in range(n_joints))
    runs = []
    for count in lengths:
        q, qd, tau = rng.normal(size=(3, count, n_joints))
        runs.append(JointSamples.single_run(names, np.arange(count) * 0.02, q, qd, tau))
    return concatenate(runs)


def no_prior(n_shared, blocks):
    return Prior.none(blocks.n_folds, n_shared)


def sample_folds(blocks):
    return np.repeat(blocks.fold, np.diff(blocks.starts))


def test_blocks_are_within_runs_and_every_run_is_in_every_fold():
    samples = recording((1000, 600, 800))
    blocks = cut(samples, samples.tau)
    assert blocks.starts[0] == 0 and blocks.starts[-1] == len(samples)
    assert 15 <= blocks.count <= 123
    for run in range(3):
        here = blocks.run == run
        assert set(blocks.fold[here]) == set(range(5))
        first = blocks.starts[:-1][here]
        assert (samples.runs[first] == run).all()
        # A fold is one stretch of a run, since samples are autocorrelated.
        assert (np.diff(blocks.fold[here]) != 0).sum() == 4


def test_the_same_stretch_of_two_runs_is_in_different_folds():
    samples = recording((1000, 1000, 1000))
    blocks = cut(samples, samples.tau)
    first, second = (blocks.fold[blocks.run == run] for run in (0, 1))
    assert (first != second).all()


def test_a_fold_of_one_run_is_every_fifth_block():
    samples = recording((1000,))
    blocks = cut(samples, samples.tau)
    np.testing.assert_array_equal(blocks.fold, np.arange(blocks.count) % 5)


def test_places_are_runs_or_stretches_of_few_runs():
    one, two, six = (cut(recording((n_rows,) * n_runs), np.zeros((n_rows * n_runs, 2)))
                     for n_rows, n_runs in ((3000, 1), (1500, 2), (500, 6)))
    assert (np.diff(one.clusters) >= 0).all() and one.clusters.max() == 4
    assert two.clusters.max() == 5
    assert [set(two.clusters[two.run == run]) for run in (0, 1)] == [{0, 1, 2}, {3, 4, 5}]
    np.testing.assert_array_equal(six.clusters, six.run)


def test_longer_correlation_makes_longer_blocks():
    samples = recording((4000,), n_joints=1)
    slow = np.convolve(samples.tau[:, 0], np.ones(40), mode='same')[:, None]
    assert cut(samples, slow).count < cut(samples, samples.tau).count


def test_too_few_samples_are_refused():
    samples = recording((50,))
    with pytest.raises(DataError, match='too few'):
        cut(samples, samples.tau)


def test_held_out_errors_are_those_of_fits_without_the_fold():
    samples = recording()
    blocks = cut(samples, samples.tau)
    rng = np.random.default_rng(1)
    x = rng.normal(size=(len(samples), 4))
    y = x @ [1.0, -2.0, 0.5, 0.0] + rng.normal(size=len(samples))
    scale, sigma = np.array([1.0, 2.0, 0.5, 3.0]), 0.7
    joint = joint_rows(x, y, blocks, scale, sigma, np.zeros(4))
    columns = np.array([0, 2, 3])
    fit = solve(joint, columns, 0, no_prior(0, blocks))
    errors = held_out_errors(joint, fit)
    folds, expected = sample_folds(blocks), np.zeros(len(y))
    for fold in range(blocks.n_folds):
        out = folds == fold
        beta = np.linalg.lstsq(x[~out][:, columns], y[~out], rcond=None)[0]
        expected[out] = ((y[out] - x[out][:, columns] @ beta) / sigma) ** 2
    np.testing.assert_allclose(errors, blocks.sums(expected), rtol=1e-5)
    beta = np.linalg.lstsq(x[:, columns], y, rcond=None)[0]
    np.testing.assert_allclose(fit.all_data / scale[columns], beta, rtol=1e-6)


def test_a_column_without_training_data_gives_finite_results():
    samples = recording()
    blocks = cut(samples, samples.tau)
    rng = np.random.default_rng(3)
    x = rng.normal(size=(len(samples), 2))
    x[sample_folds(blocks) != 1, 1] = 0.0
    joint = joint_rows(x, x[:, 0], blocks, np.ones(2), 1.0, np.zeros(2))
    assert joint.grams[1, 1, 1] == 0.0
    fit = solve(joint, np.arange(2), 0, no_prior(0, blocks))
    np.testing.assert_allclose(fit.by_fold[:, 0], 1.0, atol=1e-6)
    assert np.isfinite(held_out_errors(joint, fit)).all()
    assert np.isfinite(shared_information(joint, np.arange(2), 1).information).all()


def test_the_largest_group_share_of_a_column():
    samples = recording()
    blocks = cut(samples, samples.tau)
    x = np.ones((len(samples), 2))
    x[np.repeat(blocks.run, np.diff(blocks.starts)) == 0, 1] = 0.0
    joint = joint_rows(x, x[:, 0], blocks, np.ones(2), 1.0, np.zeros(2))
    np.testing.assert_allclose(largest_group_share(
        joint, np.arange(2), joint.group_of_rows(blocks.run)), [1000 / 1600, 1.0])


def test_products_computed_on_demand_equal_stored_ones():
    samples = recording()
    blocks = cut(samples, samples.tau)
    x = np.random.default_rng(4).normal(size=(len(samples), 5))
    some, every = (joint_rows(x, x[:, 0], blocks, np.ones(5), 1.0, np.full(5, 2.0), n_core)
                   for n_core in (2, None))
    assert some.grams.shape[1] == 2
    for columns in (np.array([0, 1]), np.array([1, 4]), np.array([3, 2])):
        np.testing.assert_allclose(some.gram(columns), every.gram(columns), rtol=1e-10)


def test_other_columns_of_gravity_equal_a_new_computation():
    samples = recording()
    blocks = cut(samples, samples.tau)
    rng = np.random.default_rng(5)
    old, new, rest = (rng.normal(size=(len(samples), k)) for k in (2, 3, 4))
    y, scale = rng.normal(size=len(samples)), np.array([1.0, 1.0, 2.0, 3.0, 0.5, 1.0])
    before = joint_rows(np.column_stack([old, rest]), y, blocks, scale, 0.7, np.arange(6.0), 5)
    result = with_gravity_columns(before, new, 2)
    expected = joint_rows(np.column_stack([new, rest]), y, blocks,
                          np.concatenate([np.ones(3), scale[2:]]), 0.7,
                          np.concatenate([np.zeros(3), np.arange(6.0)[2:]]), 6)
    for name in ('x', 'y', 'grams', 'right_sides', 'ridge', 'scale'):
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), rtol=1e-9,
                                   atol=1e-9)


def test_a_fit_with_the_prior_of_other_joints_is_the_joint_fit():
    samples = recording()
    blocks = cut(samples, samples.tau)
    rng = np.random.default_rng(2)
    shared = rng.normal(size=(2, len(samples), 3))
    own = rng.normal(size=(2, len(samples), 1))
    weights = np.array([1.0, -1.0, 2.0])
    y = [shared[n] @ weights + 0.5 * own[n][:, 0] + rng.normal(size=len(samples))
         for n in range(2)]
    joints = [joint_rows(np.column_stack([shared[n], own[n]]), y[n], blocks, np.ones(4), 1.0,
                         np.zeros(4)) for n in range(2)]
    every = np.arange(4)
    prior = shared_information(joints[1], every, 3)
    fit = solve(joints[0], every, 3, prior)
    zero = np.zeros((len(samples), 1))
    stacked = np.vstack([np.column_stack([shared[0], own[0], zero]),
                         np.column_stack([shared[1], zero, own[1]])])
    whole = np.linalg.lstsq(stacked, np.concatenate(y), rcond=None)[0]
    np.testing.assert_allclose(fit.all_data, whole[:4], rtol=1e-5, atol=1e-7)


def test_intervals_cover_the_truth_with_autocorrelated_samples():
    inside, trials = 0, 60
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        count = 3000
        x = np.sign(np.sin(np.arange(count) / 90.0 + rng.uniform(0, 6)))[:, None]
        noise = np.convolve(rng.normal(size=count + 49), np.ones(50) / 7.0, mode='valid')
        samples = JointSamples.single_run(('a',), np.arange(count) * 0.02, x, x, x)
        blocks = cut(samples, noise[:, None])
        joint = joint_rows(x, 0.3 * x[:, 0] + noise, blocks, np.ones(1), 1.0, np.zeros(1))
        fit = solve(joint, np.array([0]), 0, no_prior(0, blocks))
        spread = np.sqrt(covariance(
            joint, fit, 0, no_prior(0, blocks),
            joint.group_of_rows(np.arange(blocks.count)))[0, 0])
        inside += abs(fit.all_data[0] - 0.3) < 1.96 * spread
    # With samples taken as independent, a third of the intervals would cover.
    assert 0.8 * trials <= inside


def test_absorbed_is_the_share_that_gravity_explains():
    samples = recording()
    blocks = cut(samples, samples.tau)
    rng = np.random.default_rng(3)
    base = rng.normal(size=(len(samples), 2))
    collinear = base @ [1.0, 1.0]
    other = rng.normal(size=len(samples))
    x = np.column_stack([base, collinear, other])
    joint = joint_rows(x, other, blocks, np.ones(4), 1.0, np.zeros(4))
    alone = Prior.none(blocks.n_folds, 2)
    assert absorbed(joint, np.array([2]), alone) == pytest.approx(1.0, abs=1e-6)
    assert absorbed(joint, np.array([3]), alone) < 0.02
    # Gravity that other joints determine cannot absorb an effect.
    sure = Prior(np.stack([1e9 * np.eye(2)] * (blocks.n_folds + 1)), alone.vector)
    assert absorbed(joint, np.array([2]), sure) < 1e-3


@pytest.mark.parametrize('wrong', [{'alpha': 0.0}, {'alpha': 1.0}, {'min_share': -0.1},
                                   {'max_effects': 0}])
def test_options_out_of_range_are_refused(wrong):
    with pytest.raises(OptionError, match='selection'):
        SelectionOptions(**wrong)


@pytest.mark.parametrize('wrong', [{'min_effective_established': -1.0}, {'max_collinearity': 1.5},
                                   {'min_runs_better': -0.1}, {'min_reduction': 2.0}])
def test_thresholds_of_a_verdict_out_of_range_are_refused(wrong):
    with pytest.raises(OptionError, match='verdict'):
        VerdictOptions(**wrong)
