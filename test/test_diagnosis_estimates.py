"""Coefficients of effects: intervals and significance."""

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis.candidates import Candidate, Layout
from gravity_comp_ros.diagnosis.estimates import (
    estimates, every_interval_covers_zero, half_widths, jointly_insignificant)
from gravity_comp_ros.diagnosis.evidence import joint_rows
from gravity_comp_ros.diagnosis.findings import Estimate
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.evaluation.blocks import cut
import numpy as np
import pytest


def chosen(own, tau):
    """Return fits of one joint with an effect that has these columns."""
    count, k = own.shape
    t = np.arange(count) * 0.02
    qd = np.sin(t)[:, None]
    samples = JointSamples.single_run(('a',), t, tau[:, None], qd, tau[:, None])
    blocks = cut(samples, tau[:, None])
    effect = all_effects()['coulomb_friction']
    candidate = Candidate(effect, 0, {}, np.arange(1, 1 + k), False, 1)
    x = np.column_stack([np.ones(count), own])
    rows = joint_rows(x, tau, blocks, np.ones(1 + k), 1.0, np.zeros(1 + k))
    fits = Fits((rows,), Layout(1, (candidate,)), blocks)
    still = np.zeros((count, 1))
    motion = Motion(samples, still, still, still[:, :, None], np.ones(1), np.ones(1))
    return fits, motion, candidate


@pytest.mark.parametrize('seed', range(5))
def test_collinear_columns_are_significant_jointly_only(seed):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=4000)
    own = np.column_stack([x, x + 0.01 * rng.normal(size=4000)])
    tau = own @ [0.5, 0.5] + rng.normal(size=4000)
    fits, motion, candidate = chosen(own, tau)
    sizes = estimates(fits, [candidate], motion, candidate,
                      half_widths(fits, [candidate], 0, motion))
    assert len(sizes) == 2 and every_interval_covers_zero(sizes)
    assert sum(one.value for one in sizes.values()) == pytest.approx(1.0, abs=0.1)
    assert not jointly_insignificant(fits, [candidate], candidate)


def test_a_large_coefficient_is_significant():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(4000, 1))
    fits, motion, candidate = chosen(x, 0.5 * x[:, 0] + rng.normal(size=4000))
    sizes = estimates(fits, [candidate], motion, candidate,
                      half_widths(fits, [candidate], 0, motion))
    assert not every_interval_covers_zero(sizes)
    assert not jointly_insignificant(fits, [candidate], candidate)


def test_an_absent_effect_is_insignificant_in_nineteen_of_twenty():
    verdicts = []
    for seed in range(60):
        rng = np.random.default_rng(100 + seed)
        fits, _, candidate = chosen(rng.normal(size=(2000, 3)), rng.normal(size=2000))
        verdicts.append(jointly_insignificant(fits, [candidate], candidate))
    assert 0.85 <= np.mean(verdicts) < 1.0


def test_intervals_are_widened_for_their_number():
    sizes = {f'c{k}': Estimate(0.0, 'N·m', (-1.0, 1.0)) for k in range(31)}
    just_off = Estimate(1.05, 'N·m', (0.05, 2.05))
    assert not every_interval_covers_zero({'one': just_off})
    assert every_interval_covers_zero({**sizes, 'one': just_off})
    assert not every_interval_covers_zero({**sizes, 'one': Estimate(1.8, 'N·m', (0.8, 2.8))})
