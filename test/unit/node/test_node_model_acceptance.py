"""Held-out comparison of a new model with the model in use."""

from dataclasses import dataclass

from bench.shared.node_messages import rows_of
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.node import checks, comparison
from gravity_comp_ros.node.comparison import Prediction
from gravity_comp_ros.node.epoch import Rows
import numpy as np
import pytest


@dataclass
class Linear:
    """A torque proportional to position."""

    gain: np.ndarray
    noise: np.ndarray

    def of(self, rows):
        return Prediction(rows.samples.q * self.gain, self.noise)


def compare(new, old, train, held, has_more_samples=False):
    rows = rows_of(train, held)
    return comparison.compare(new.of(rows), old and old.of(rows), rows, has_more_samples)


def refusal(comparison):
    return checks.failed(comparison.checks)


def model(*gain, noise=0.1):
    return Linear(np.array(gain), np.full(len(gain), noise))


def samples(gain, n=200, noise=0.1, seed=0, spread=1.0):
    rng = np.random.default_rng(seed)
    q = spread * rng.uniform(-1, 1, (n, len(gain)))
    tau = q * gain + noise * rng.standard_normal(q.shape)
    return JointSamples.single_run([f'j{k}' for k in range(len(gain))], np.arange(n), q, 0 * q,
                                   tau)


TRAIN, HELD = samples((5.0, 3.0)), samples((5.0, 3.0), seed=1)


def test_the_better_model_wins_in_either_order():
    good, bad = model(5.0, 3.0), model(4.0, 2.0)
    assert compare(good, bad, TRAIN, HELD).is_better
    verdict = compare(bad, good, TRAIN, HELD)
    assert refusal(verdict).text == 'worse on j0, j1'
    rmse = np.sqrt(np.mean((HELD.tau - HELD.q * [4.0, 2.0]) ** 2, axis=0))
    assert f'held-out RMSE {np.sqrt((rmse ** 2).mean()):.3g} N·m' in verdict.figures
    assert f'worst joint j1 {rmse[1]:.3g},' in verdict.figures


def test_of_equal_models_the_one_with_more_samples_is_better():
    truth, nearly = model(5.0, 3.0), model(5.005, 3.005)
    assert not compare(nearly, truth, TRAIN, HELD).is_better
    rows = Rows(samples((5.0, 3.0), n=400), np.arange(400) // 5 % 2 == 1)
    for new, is_better in ((nearly, True), (model(5.1, 3.1), False)):
        result = comparison.compare(new.of(rows), truth.of(rows), rows, has_more_samples=True)
        assert result.is_better == is_better


def test_the_ratio_of_two_errors_varies_as_over_other_samples():
    """Errors are autocorrelated: those of five consecutive samples are equal."""
    ratios, stds, scale = [], [], np.array([1.0, 1.1])
    for seed in range(300):
        rng = np.random.default_rng(seed)
        new, old = (scale * np.repeat(rng.standard_normal((40, 2)), 5, axis=0) for _ in range(2))
        ratios.append(np.sqrt((new ** 2).mean() / (old ** 2).mean()))
        stds.append(comparison.ratio_std(new, old, np.ones((200, 2)), 1 + np.arange(200) // 5))
    assert np.mean(stds) == pytest.approx(np.std(ratios), rel=0.15)


def test_a_worse_joint_prevents_acceptance():
    verdict = compare(model(5.0, 2.0), model(0.0, 3.0), TRAIN, HELD)
    assert refusal(verdict).text == 'worse on j1'


def test_a_first_model_must_beat_a_constant_torque():
    assert compare(model(5.0, 3.0), None, TRAIN, HELD).is_better
    assert not compare(model(-5.0, -3.0), None, TRAIN, HELD).is_better


def test_effort_without_gravity_is_recognised():
    train, held = samples((0.0, 0.0)), samples((0.0, 0.0), seed=1)
    verdict = compare(model(0.01, 0.0), None, train, held)
    assert verdict.is_compensated and refusal(verdict).name == checks.POSE_EXPLAINS
    assert 'compensate' in refusal(verdict).text


def test_a_short_or_narrow_motion_does_not_show_compensation():
    few = samples((0.0, 0.0), n=50)
    assert not compare(model(0.0, 0.0), None, few, HELD).is_compensated
    narrow = samples((0.0, 0.0), spread=0.1)
    verdict = compare(model(1e-6, 1e-6), None, narrow, samples((0.0, 0.0), seed=1, spread=0.1))
    assert not verdict.is_compensated and not verdict.is_better
