"""Effort that is no effort, published torque that comes back, a taken model that is wrong."""

from dataclasses import replace

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.node.effort_health import EffortHealth, FROZEN, OFF
from gravity_comp_ros.node.model_watch import ModelWatch, WINDOW
from gravity_comp_ros.node.self_confirmation import (
    DELAYS, echo_objection, SentTorque, SentTorqueHistory)
from hypothesis import example, given, strategies as st
import numpy as np
import pytest

NOISE = np.full(2, 0.1)
HEAVY = np.array([30.0, 10.0])


def test_next_to_no_effort_of_a_heavy_arm_is_none():
    health = EffortHealth()
    assert health.fault(np.zeros(2), np.array([0.1, -0.1]), HEAVY, NOISE) == OFF
    assert health.fault(np.zeros(2), 0.3 * HEAVY, HEAVY, NOISE) is None
    assert health.fault(np.zeros(2), np.array([0.1, 0.1]), 5 * NOISE, NOISE) is None


@given(st.floats(0.1, 3.0), st.floats(-20.0, 20.0))
def test_no_payload_that_leaves_a_third_of_the_gravity_is_taken_for_none(factor, more):
    tau = np.maximum(factor, 0.34) * HEAVY + [0.0, more if more > 0 else 0.0]
    assert EffortHealth().fault(np.zeros(2), tau, HEAVY, NOISE) is None


def test_effort_that_repeats_itself_while_the_arm_moves_is_frozen():
    health, tau = EffortHealth(), np.array([3.0, 4.0])
    found = [health.fault(np.full(2, 0.02 * k), tau, None, None) for k in range(6)]
    assert found == [None, None, None, FROZEN, FROZEN, FROZEN]
    assert health.fault(np.full(2, 0.2), tau + 1e-9, None, None) is None
    still = [EffortHealth().fault(np.zeros(2), tau, None, None) for _ in range(50)]
    assert not any(still)
    zero = EffortHealth()
    assert [zero.fault(np.full(2, 0.04 * k), 0 * tau, None, None) for k in range(3)][-1] == OFF


def test_one_joint_that_repeats_itself_while_its_torque_changes_is_frozen():
    """A sensor at the end of its range, say; what is within the noise of its model is no sign."""
    health, found = EffortHealth(), []
    for k in range(12):
        predicted = HEAVY + [0.3 * k, 0.0]
        found.append(health.fault(np.full(2, 0.02 * k), np.array([20.0, 10.0 + 1e-3 * k]),
                                  predicted, NOISE))
    assert found == 4 * [None] + 8 * [FROZEN] and health.frozen == (0,)
    assert health.fault(np.full(2, 0.3), np.array([20.1, 10.5]), HEAVY, NOISE) is None
    # At rest the prediction changes with a new model, or with the sign of friction.
    resting = EffortHealth()
    assert not any(resting.fault(np.zeros(2), np.array([20.0, 10.0 + 1e-3 * k]),
                                 HEAVY + [2.0 * k, 0.0], NOISE) for k in range(12))


@given(st.floats(0.01, 0.4), st.integers(0, 1000))
@example(0.392578125, 946)
def test_a_coarse_sensor_is_not_frozen(step, seed):
    """The residual of the training holds the steps of the sensor."""
    samples, health = motion(seed=seed, noise=0.01), EffortHealth()
    truth = samples.q * [20.0, 8.0]
    coarse = step * np.round(samples.tau / step)
    noise = np.maximum((coarse - truth).std(axis=0), 0.05)
    assert not any(health.fault(*row, noise) for row in zip(samples.q, coarse, truth))


def motion(n=120, seed=0, gain=(20.0, 8.0), noise=0.1):
    t = 0.2 * np.arange(n)
    q = np.stack([0.7 * np.sin(0.1 * t), 0.5 * np.cos(0.13 * t)], axis=1)
    truth = q * np.array(gain)
    tau = truth + noise * np.random.default_rng(seed).standard_normal(q.shape)
    return JointSamples.single_run(['a', 'b'], t, q, 0 * q, tau)


def split(values):
    return values[:90], values[90:]


def echoed(sent, samples, model):
    """Return the objection to a model (M, N) when `sent` (M, D, N) was published."""
    train, held = samples.select(np.arange(90)), samples.select(np.arange(90, len(samples)))
    return echo_objection(SentTorque(*split(sent)), train, held, *split(model))


@pytest.mark.parametrize('delay', range(len(DELAYS)))
def test_effort_that_is_what_was_sent_confirms_nothing(delay):
    samples = motion()
    wrong = 0.5 * samples.q * [20.0, 8.0]
    # A floating arm measures what was sent, some time ago; the other delays are of other poses.
    sent = np.repeat(wrong[:, None], len(DELAYS), axis=1) + 0.5
    sent[:, delay] = wrong
    measured = replace(samples, tau=wrong + 0.1 * np.random.default_rng(3).standard_normal(
        wrong.shape))
    why = echoed(sent, measured, wrong)
    assert 'the torque that this node published' in why
    assert f'{1e3 * DELAYS[delay]:.0f} ms' in why


def test_an_arm_that_its_controller_moves_shows_more_than_was_sent():
    samples = motion()
    truth = samples.q * [20.0, 8.0]
    sent = np.repeat((0.9 * truth)[:, None], len(DELAYS), axis=1)
    assert echoed(sent, samples, truth) is None
    assert echoed(np.full_like(sent, np.nan), samples, 0.9 * truth) is None
    assert echoed(0 * sent, samples, truth) is None


def test_a_light_payload_is_not_hidden_by_friction_that_a_controller_supplies():
    samples = motion()
    t = samples.t
    qd = np.stack([0.07 * np.cos(0.1 * t), -0.065 * np.sin(0.13 * t)], axis=1)
    published = samples.q * [20.0, 8.0]
    friction = 3.0 * np.tanh(qd / 0.01)
    noise = 0.1 * np.random.default_rng(4).standard_normal(published.shape)
    loaded = published + samples.q * [1.0, 0.0]
    sent = np.repeat(published[:, None], len(DELAYS), axis=1)
    pushed = replace(samples, qd=qd, tau=loaded + friction + noise)
    assert echoed(sent, pushed, loaded) is None
    led = replace(samples, qd=qd, tau=published + noise)
    assert echoed(sent, led, published) is not None


def test_sent_torque_is_that_which_held():
    sent = SentTorqueHistory(1)
    assert np.isnan(sent.before(0.0)).all()
    for k in range(400):
        sent.published(0.001 * k, np.array([float(k)]))
    found = sent.before(0.3995)[:, 0]
    np.testing.assert_allclose(found, [399, 395, 389, 379, 349, 299, 199], atol=1)
    sent.published(0.0, np.array([7.0]))
    assert np.isnan(sent.before(0.0)).all()
    assert np.nanmax(sent.before(0.001)) == 7.0


def model(gain):
    return fit(motion(300, 1, gain)).model


@pytest.fixture(scope='module')
def models():
    return model((20.0, 8.0)), model((30.0, 8.0))


def offer(watch, model, samples):
    for q, tau in zip(samples.q, samples.tau):
        watch.offer(q, tau, model.predict_one(q))


def test_a_wrong_model_is_told_from_the_one_before(models):
    right, wrong = models
    watch = ModelWatch(wrong, right, 30)
    offer(watch, wrong, motion(WINDOW - 1))
    assert watch.objection() is None
    offer(watch, wrong, motion(60))
    assert 'that of the previous model' in watch.objection() and not watch.is_confirmed


def test_a_confirmed_model_stays_whatever_comes(models):
    right, wrong = models
    watch = ModelWatch(wrong, right, 30)
    offer(watch, wrong, motion(100, 2, (30.0, 8.0)))
    assert watch.is_confirmed
    offer(watch, wrong, motion(60))
    assert watch.objection() is None


def test_where_both_models_are_wrong_neither_is_preferred(models):
    right, wrong = models
    watch = ModelWatch(wrong, right, 30)
    offer(watch, wrong, motion(60, 3, (60.0, -8.0)))
    assert watch.objection() is None
    assert ModelWatch(right, None, 0).is_confirmed
