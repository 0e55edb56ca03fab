"""Held-out errors with one more effect equal those of a fit with it."""

from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.diagnosis.candidates import Candidate, Layout
from gravity_comp_ros.diagnosis.evidence import joint_rows
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.evaluation.blocks import cut
from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

N_BASE, N_ARM, N_OWN = 4, 3, 3


def fits(seed, prior=0.0, n_core=None):
    """Return fits of three joints: gravity, two effects of the arm, two of each joint."""
    rng = np.random.default_rng(seed)
    count, joints = 400, 3
    runs = [JointSamples.single_run(('a', 'b', 'c'), np.arange(count) * 0.02,
                                    *rng.normal(size=(3, count, joints))) for _ in range(2)]
    samples = concatenate(runs)
    blocks = cut(samples, samples.tau)
    effect, rows, candidates = all_effects()['coulomb_friction'], [], []
    arm = [Candidate(effect, None, {'k': float(k)}, np.arange(N_BASE + k, N_BASE + k + size),
                     True, 1) for k, size in ((0, 1), (1, 2))]
    for joint in range(joints):
        x = rng.normal(size=(2 * count, N_BASE + N_ARM + N_OWN))
        # Columns of effects that are nearly collinear with gravity.
        x[:, -1] = x[:, 0] + 0.05 * x[:, -1]
        y = x @ rng.normal(size=x.shape[1]) + rng.normal(size=2 * count)
        rows.append(joint_rows(x, y, blocks, np.full(x.shape[1], 2.0), 0.5,
                               np.full(x.shape[1], prior), n_core))
        at = N_BASE + N_ARM
        candidates += [Candidate(effect, joint, {}, np.arange(at, at + 1), False, 1),
                       Candidate(effect, joint, {'k': 1.0}, np.arange(at + 1, at + 3), False, 1)]
    every = (*arm, *candidates)
    return Fits(tuple(rows), Layout(N_BASE, every), blocks), arm, candidates


@settings(max_examples=15)
@given(st.integers(0, 10 ** 6), st.sampled_from([0.0, 3.0]), st.sampled_from([None, 6]))
def test_errors_with_an_effect_of_one_joint(seed, prior, n_core):
    every, arm, own = fits(seed, prior, n_core)
    for chosen in ([], [arm[0]], [own[0], own[2]], [arm[1], own[4]]):
        others = [c for c in own if c.joint == 1 and c not in chosen]
        computed = every.errors_with_each(1, chosen, others)
        for candidate, errors in zip(others, computed):
            np.testing.assert_allclose(errors, every.errors(1, [*chosen, candidate]), rtol=1e-4)


@settings(max_examples=15)
@given(st.integers(0, 10 ** 6), st.sampled_from([0.0, 3.0]), st.sampled_from([None, 6]))
def test_errors_with_effects_of_the_whole_arm(seed, prior, n_core):
    every, arm, own = fits(seed, prior, n_core)
    for chosen in ([], [own[0], own[3]]):
        for joint in (None, 2):
            computed = every.errors_with_each(joint, chosen, arm)
            for candidate, errors in zip(arm, computed):
                np.testing.assert_allclose(
                    errors, every.errors(joint, [*chosen, candidate]), rtol=1e-4)


@pytest.mark.parametrize('seed', range(3))
def test_errors_of_all_joints_with_effects_of_some(seed):
    every, arm, own = fits(seed)
    mixed = [arm[1], own[0], own[3]]
    computed = every.errors_with_each(None, [own[4]], mixed)
    assert [part.shape for part in computed] == [(every.blocks.count, 3)] * 3
    for candidate, errors in zip(mixed, computed):
        np.testing.assert_allclose(errors, every.errors(None, [own[4], candidate]), rtol=1e-4)


def test_the_order_of_effects_does_not_matter():
    every, arm, own = fits(7)
    chosen = [own[2], arm[1], own[0]]
    np.testing.assert_array_equal(every.errors(0, chosen), every.errors(0, chosen[::-1]))


def test_refolded_fits_keep_columns_and_effects():
    every, arm, own = fits(3)
    chosen = [own[3], arm[1], own[0]]
    again, moved = every.refolded(chosen, every.blocks)
    np.testing.assert_allclose(again.errors(None, moved), every.errors(None, chosen), rtol=1e-6)
    for before, after in zip(chosen, moved):
        np.testing.assert_allclose(again.coefficients(after, moved),
                                   every.coefficients(before, chosen), rtol=1e-5)


@settings(max_examples=10)
@given(st.integers(0, 10 ** 6), st.sampled_from([0.0, 3.0]))
def test_explained_squares_are_the_reduction_of_the_cost(seed, prior):
    every, arm, own = fits(seed, prior)

    def cost(chosen):
        total = 0.0
        for joint, rows in enumerate(every.rows):
            fit = every.fit(joint, chosen)
            residual = rows.y - rows.x[:, fit.columns] @ fit.all_data
            n_shared = len(every.shared(chosen))
            ridge = rows.ridge[fit.columns]
            total += float(residual @ residual) + float(ridge @ fit.all_data ** 2)
            assert n_shared <= len(fit.columns)
        return total

    chosen = [own[0], own[2]]
    for candidate, found in zip([*arm, own[4]],
                                every.explained_by_each(chosen, [*arm, own[4]])):
        expected = cost(chosen) - cost([*chosen, candidate])
        assert found == pytest.approx(expected, rel=1e-3, abs=1e-3)
