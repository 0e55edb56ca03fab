"""Broken effort of single samples, an echo of the published torque, watch of a new model."""

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


def test_almost_no_effort_of_a_loaded_arm_is_off():
    health = EffortHealth()
    assert health.fault(np.zeros(2), np.array([0.1, -0.1]), HEAVY, NOISE) == OFF
    assert health.fault(np.zeros(2), 0.3 * HEAVY, HEAVY, NOISE) is None
    assert health.fault(np.zeros(2), np.array([0.1, 0.1]), 5 * NOISE, NOISE) is None


@given(st.floats(0.1, 3.0), st.floats(-20.0, 20.0))
def test_effort_with_a_third_of_the_gravity_is_not_off(factor, more):
    tau = np.maximum(factor, 0.34) * HEAVY + [0.0, more if more > 0 else 0.0]
    assert EffortHealth().fault(np.zeros(2), tau, HEAVY, NOISE) is None


def test_constant_effort_of_a_moving_arm_is_frozen():
    health, tau = EffortHealth(), np.array([3.0, 4.0])
    result = [health.fault(np.full(2, 0.02 * k), tau, None, None) for k in range(6)]
    assert result == [None, None, None, FROZEN, FROZEN, FROZEN]
    assert health.fault(np.full(2, 0.2), tau + 1e-9, None, None) is None
    still = [EffortHealth().fault(np.zeros(2), tau, None, None) for _ in range(50)]
    assert not any(still)
    zero = EffortHealth()
    assert [zero.fault(np.full(2, 0.04 * k), 0 * tau, None, None) for k in range(3)][-1] == OFF


def test_constant_effort_of_one_joint_whose_torque_changes_is_frozen():
    """A saturated sensor; a change of the prediction within its noise is not significant."""
    health, result = EffortHealth(), []
    for k in range(12):
        predicted = HEAVY + [0.3 * k, 0.0]
        result.append(health.fault(np.full(2, 0.02 * k), np.array([20.0, 10.0 + 1e-3 * k]),
                                   predicted, NOISE))
    assert result == 4 * [None] + 8 * [FROZEN] and health.frozen == (0,)
    assert health.fault(np.full(2, 0.3), np.array([20.1, 10.5]), HEAVY, NOISE) is None
    # At rest the prediction changes with the model or the sign of friction.
    resting = EffortHealth()
    assert not any(resting.fault(np.zeros(2), np.array([20.0, 10.0 + 1e-3 * k]),
                                 HEAVY + [2.0 * k, 0.0], NOISE) for k in range(12))


@given(st.floats(0.01, 0.4), st.integers(0, 1000))
@example(0.392578125, 946)
def test_a_coarse_sensor_is_not_frozen(step, seed):
    """The residual of the training includes the steps of the sensor."""
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


def echo_of(sent, samples, model):
    """Return the objection to a model (M, N) when `sent` (M, D, N) was published."""
    train, held = samples.select(np.arange(90)), samples.select(np.arange(90, len(samples)))
    return echo_objection(SentTorque(*split(sent)), train, held, *split(model))


@pytest.mark.parametrize('delay', range(len(DELAYS)))
def test_an_echo_of_the_published_torque_is_refused(delay):
    samples = motion()
    wrong = 0.5 * samples.q * [20.0, 8.0]
    # A floating arm measures the torque sent at one delay; other delays have another torque.
    sent = np.repeat(wrong[:, None], len(DELAYS), axis=1) + 0.5
    sent[:, delay] = wrong
    measured = replace(samples, tau=wrong + 0.1 * np.random.default_rng(3).standard_normal(
        wrong.shape))
    why = echo_of(sent, measured, wrong)
    assert 'the torque that this node published' in why
    assert f'{1e3 * DELAYS[delay]:.0f} ms' in why


def test_an_arm_moved_by_its_controller_is_no_echo():
    samples = motion()
    truth = samples.q * [20.0, 8.0]
    sent = np.repeat((0.9 * truth)[:, None], len(DELAYS), axis=1)
    assert echo_of(sent, samples, truth) is None
    assert echo_of(np.full_like(sent, np.nan), samples, 0.9 * truth) is None
    assert echo_of(0 * sent, samples, truth) is None


def test_friction_torque_of_a_controller_does_not_hide_a_light_payload():
    samples = motion()
    t = samples.t
    qd = np.stack([0.07 * np.cos(0.1 * t), -0.065 * np.sin(0.13 * t)], axis=1)
    published = samples.q * [20.0, 8.0]
    friction = 3.0 * np.tanh(qd / 0.01)
    noise = 0.1 * np.random.default_rng(4).standard_normal(published.shape)
    loaded = published + samples.q * [1.0, 0.0]
    sent = np.repeat(published[:, None], len(DELAYS), axis=1)
    pushed = replace(samples, qd=qd, tau=loaded + friction + noise)
    assert echo_of(sent, pushed, loaded) is None
    led = replace(samples, qd=qd, tau=published + noise)
    assert echo_of(sent, led, published) is not None


def test_sent_torque_is_the_last_one_before_each_delay():
    sent = SentTorqueHistory(1)
    assert np.isnan(sent.before(0.0)).all()
    for k in range(400):
        sent.published(0.001 * k, np.array([float(k)]))
    result = sent.before(0.3995)[:, 0]
    np.testing.assert_allclose(result, [399, 395, 389, 379, 349, 299, 199], atol=1)
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


def test_a_wrong_model_has_an_objection(models):
    right, wrong = models
    watch = ModelWatch(wrong, right, 30)
    offer(watch, wrong, motion(WINDOW - 1))
    assert watch.objection() is None
    offer(watch, wrong, motion(60))
    assert 'that of the previous model' in watch.objection() and not watch.is_confirmed


def test_a_confirmed_model_has_no_objection(models):
    right, wrong = models
    watch = ModelWatch(wrong, right, 30)
    offer(watch, wrong, motion(100, 2, (30.0, 8.0)))
    assert watch.is_confirmed
    offer(watch, wrong, motion(60))
    assert watch.objection() is None


def test_two_wrong_models_have_no_objection(models):
    right, wrong = models
    watch = ModelWatch(wrong, right, 30)
    offer(watch, wrong, motion(60, 3, (60.0, -8.0)))
    assert watch.objection() is None
    assert ModelWatch(right, None, 0).is_confirmed
