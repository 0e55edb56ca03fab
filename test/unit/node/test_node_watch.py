"""Echo of the published torque, and watch of a new model."""

from dataclasses import dataclass, replace
import re

from bench.shared.node_messages import rows_of, slow_sample
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.node import acceptance, checks
from gravity_comp_ros.node.acceptance import Candidate, not_output
from gravity_comp_ros.node.epoch import DelayedSamples, Rows
from gravity_comp_ros.node.messages import CompleteReading
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.watch import Watch, WINDOW
import numpy as np
import pytest


def motion(n=120, seed=0, gain=(20.0, 8.0), noise=0.1, shift=0.0):
    t = 0.2 * np.arange(n) - shift
    q = np.stack([0.7 * np.sin(0.1 * t), 0.5 * np.cos(0.13 * t)], axis=1)
    truth = np.sin(q) * np.array(gain)
    tau = truth + noise * np.random.default_rng(seed).standard_normal(q.shape)
    return JointSamples.single_run(['a', 'b'], t, q, 0 * q, tau)


def echo_of(sent, samples, model):
    """Return the check of a model (M, N) when `sent` (M, 2, N) was published."""
    rows = Rows(samples, np.arange(len(samples)) >= 90, sent)
    return not_output(rows, Candidate(None, model, np.full(2, 0.1)))


@pytest.mark.parametrize('delay', [0.0, 0.004, 0.032, 0.11, NODE.max_delay])
def test_an_echo_of_the_published_torque_is_refused_at_any_delay(delay):
    samples = motion()

    def published(delay):
        return np.sin(motion(shift=delay).q) * [10.0, 4.0]

    echo, late = published(delay), published(0.5)
    noise = 0.01 * np.random.default_rng(3).standard_normal(samples.q.shape)
    # On a busy machine some messages are late.
    is_late = np.arange(120)[:, None] % 10 == 0
    measured = replace(samples, tau=np.where(is_late, late, echo) + noise)
    sent = np.stack([published(0.0), published(NODE.max_delay)], axis=1)
    check = echo_of(sent, measured, echo)
    assert check.name == checks.NOT_OUTPUT and not check.passed
    assert float(re.search(r'(\d+) ms', check.text)[1]) == pytest.approx(1e3 * delay, abs=2.0)
    # A model that explains half of the noise.
    better = echo_of(sent, measured, echo + 0.5 * noise)
    assert better.statistic == pytest.approx(0.5, rel=0.2)


def test_an_arm_moved_by_its_controller_is_no_echo():
    samples = motion()
    truth = np.sin(samples.q) * [20.0, 8.0]
    sent = np.repeat((0.9 * truth)[:, None], 2, axis=1)
    assert echo_of(sent, samples, truth).passed
    assert echo_of(np.full_like(sent, np.nan), samples, 0.9 * truth) is None
    assert echo_of(0 * sent, samples, truth) is None


def test_friction_torque_of_a_controller_does_not_hide_a_light_payload():
    samples = motion()
    t = samples.t
    qd = np.stack([0.07 * np.cos(0.1 * t), -0.065 * np.sin(0.13 * t)], axis=1)
    published = np.sin(samples.q) * [20.0, 8.0]
    friction = 3.0 * np.tanh(qd / 0.01)
    noise = 0.1 * np.random.default_rng(4).standard_normal(published.shape)
    loaded = published + np.sin(samples.q) * [1.0, 0.0]
    sent = np.repeat(published[:, None], 2, axis=1)
    pushed = replace(samples, qd=qd, tau=loaded + friction + noise)
    assert echo_of(sent, pushed, loaded).passed
    led = replace(samples, qd=qd, tau=published + noise)
    assert not echo_of(sent, led, published).passed


def test_sent_torques_are_those_before_the_sample_and_the_largest_delay():
    delayed, zero = DelayedSamples(), np.zeros(1)
    for k in range(600):
        # The torque of the message before; nothing was published before the first one.
        sent = np.array([k - 1.0 if k else np.nan])
        delayed.add(CompleteReading(0.001 * k, zero, zero, zero), sent, k in (0, 400))
    first, later = delayed.due(0.6)
    assert np.isnan(first.sent).all()
    np.testing.assert_allclose(later.sent[:, 0], [399, 199], atol=1)


def model(gain):
    return fit(motion(300, 1, gain), FitOptions('potential')).model


@pytest.fixture(scope='module')
def models():
    return model((20.0, 8.0)), model((30.0, 8.0))


def watching(model, before, learned):
    watch = Watch(16.0)
    watch.use(model, before, learned)
    return watch


def offer(watch, model, samples):
    for t, q, qd, tau in zip(samples.t, samples.q, samples.qd, samples.tau):
        gravity = model.predict_one(q)
        watch.offer(slow_sample(t, q, qd, tau), gravity, tau - gravity)


def is_rolled_back(watch):
    judged = watch.model_checks()
    return bool(judged) and not any(check.passed for check in judged)


def test_a_wrong_model_is_rolled_back(models):
    right, wrong = models
    watch = watching(wrong, right, 30)
    offer(watch, wrong, motion(WINDOW - 1))
    assert not watch.model_checks()
    offer(watch, wrong, motion(60))
    assert is_rolled_back(watch) and not watch.is_confirmed
    assert 'that of the previous model' in watch.model_checks()[0].text


def test_a_confirmed_model_stays(models):
    right, wrong = models
    watch = watching(wrong, right, 30)
    offer(watch, wrong, motion(100, 2, (30.0, 8.0)))
    assert watch.is_confirmed
    offer(watch, wrong, motion(60))
    assert not is_rolled_back(watch)


def test_of_two_wrong_models_the_new_one_stays(models):
    right, wrong = models
    watch = watching(wrong, right, 30)
    offer(watch, wrong, motion(60, 3, (60.0, -8.0)))
    assert watch.model_checks() and not is_rolled_back(watch)
    assert watching(right, None, 0).is_confirmed


@dataclass
class Linear:
    """A torque proportional to position."""

    gain: np.ndarray
    noise: np.ndarray

    def of(self, rows):
        return Candidate(None, rows.samples.q * self.gain, self.noise)


def compare(new, old, train, held, has_more_samples=False):
    rows = rows_of(train, held)
    return acceptance.compare(new.of(rows), old and old.of(rows), rows, has_more_samples)


def refusal(compared):
    return checks.failed(compared[0])


def is_better(*compared, **options):
    return refusal(compare(*compared, **options)) is None


def linear(*gain, noise=0.1):
    return Linear(np.array(gain), np.full(len(gain), noise))


def samples(gain, n=200, noise=0.1, seed=0, spread=1.0):
    rng = np.random.default_rng(seed)
    q = spread * rng.uniform(-1, 1, (n, len(gain)))
    tau = q * gain + noise * rng.standard_normal(q.shape)
    return JointSamples.single_run([f'j{k}' for k in range(len(gain))], np.arange(n), q, 0 * q,
                                   tau)


TRAIN, HELD = samples((5.0, 3.0)), samples((5.0, 3.0), seed=1)


def test_the_better_model_wins_in_either_order():
    good, bad = linear(5.0, 3.0), linear(4.0, 2.0)
    assert is_better(good, bad, TRAIN, HELD)
    verdict = compare(bad, good, TRAIN, HELD)
    assert refusal(verdict).text == 'worse on j0, j1'
    rmse = np.sqrt(np.mean((HELD.tau - HELD.q * [4.0, 2.0]) ** 2, axis=0))
    assert f'held-out RMSE {np.sqrt((rmse ** 2).mean()):.3g} N·m' in verdict[1]
    assert f'worst joint j1 {rmse[1]:.3g},' in verdict[1]


def test_of_equal_models_the_one_with_more_samples_is_better():
    truth, nearly = linear(5.0, 3.0), linear(5.005, 3.005)
    assert not is_better(nearly, truth, TRAIN, HELD)
    rows = Rows(samples((5.0, 3.0), n=400), np.arange(400) // 5 % 2 == 1)
    for new, expected in ((nearly, True), (linear(5.1, 3.1), False)):
        result = acceptance.compare(new.of(rows), truth.of(rows), rows, has_more_samples=True)
        assert (refusal(result) is None) == expected


def test_the_ratio_of_two_errors_varies_as_over_other_samples():
    """Errors are autocorrelated: those of five consecutive samples are equal."""
    ratios, stds, scale = [], [], np.array([1.0, 1.1])
    for seed in range(300):
        rng = np.random.default_rng(seed)
        new, old = (scale * np.repeat(rng.standard_normal((40, 2)), 5, axis=0) for _ in range(2))
        ratios.append(np.sqrt((new ** 2).mean() / (old ** 2).mean()))
        stds.append(acceptance.ratio_std(new, old, np.ones((200, 2)), 1 + np.arange(200) // 5))
    assert np.mean(stds) == pytest.approx(np.std(ratios), rel=0.15)


def test_a_worse_joint_prevents_acceptance():
    verdict = compare(linear(5.0, 2.0), linear(0.0, 3.0), TRAIN, HELD)
    assert refusal(verdict).text == 'worse on j1'
    # A first model must beat a constant torque.
    assert is_better(linear(5.0, 3.0), None, TRAIN, HELD)
    assert not is_better(linear(-5.0, -3.0), None, TRAIN, HELD)


def test_effort_without_gravity_is_recognised():
    train, held = samples((0.0, 0.0)), samples((0.0, 0.0), seed=1)
    verdict = compare(linear(0.01, 0.0), None, train, held)
    assert refusal(verdict).name == checks.POSE_EXPLAINS
    assert 'compensate' in refusal(verdict).text
    # A short or narrow motion does not show it, so that a fault is named.
    few = samples((0.0, 0.0), n=50)
    assert 'compensate' not in refusal(compare(linear(0.0, 0.0), None, few, HELD)).text
    narrow = samples((0.0, 0.0), spread=0.1)
    verdict = compare(linear(1e-6, 1e-6), None, narrow, samples((0.0, 0.0), seed=1, spread=0.1))
    assert refusal(verdict) and 'compensate' not in refusal(verdict).text
