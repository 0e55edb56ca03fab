"""External torque: a push is found with its size, friction at rest and bad input are not."""

from dataclasses import fields

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import ModelMismatchError, OptionError
from gravity_comp_ros.evaluation.external_torque import (
    external_torque, ExternalTorqueObserver, ExternalTorqueOptions, mean_weights)
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.expansion import Expansion
import numpy as np
import pytest

NOISE, FRICTION, RATE = 0.1, 2.0, 100.0
COULOMB = AppliedEffect('coulomb_friction', 'b', {'width': 0.002},
                        {'F_c': Value(FRICTION, 'N·m', (1.9, 2.1))})
DRIFT = AppliedEffect('torque_drift', 'a', {'origin': 0.0, 'time': 100.0},
                      {'r': Value(1.0, 'N·m', (0.9, 1.1))})


def model(*fitted):
    """Return tau = (8 sin q_a, 3 sin q_b), trained within 1 rad, and effects as nuisance terms."""
    torques = tuple(Expansion(np.array([k]), np.array([w])) for k, w in ((3, 8.0), (1, 3.0)))
    return GravityModel(('a', 'b'), 'per_joint', torques, None, np.full(2, NOISE),
                        Coverage(np.full(2, -1.0), np.full(2, 1.0), 100), fitted=Applied(fitted))


MODEL = model(COULOMB)


def motion(push=0.0, start=1.0, duration=3.0, speed=0.2):
    """Return a motion at constant speed with friction on b, and a push of b from `start` on."""
    t = np.arange(0.0, duration, 1.0 / RATE)
    q = np.column_stack([-0.5 + 0.1 * t, -0.5 + speed * t])
    qd = np.broadcast_to([0.1, speed], q.shape)
    tau = MODEL.predict(q) + NOISE * np.random.default_rng(0).normal(size=q.shape)
    tau[:, 1] += FRICTION * np.sign(speed) + push * (t >= start)
    return JointSamples.single_run(('a', 'b'), t, q, qd, tau)


def test_the_weights_are_those_of_the_slope():
    t = np.sort(np.random.default_rng(1).uniform(0.0, 0.05, 9))
    times = t - t.mean()
    slope = times / (times @ times)
    weights = mean_weights(times, slope)
    # Speeds whose acceleration is 1 + 40 t, which is linear within each interval.
    assert slope @ (t + 20.0 * t ** 2) == pytest.approx(weights @ (1.0 + 40.0 * t), rel=1e-12)
    assert weights.sum() == pytest.approx(1.0) and (weights > 0.0).all()


def test_a_push_of_five_standard_deviations_is_found_within_50_ms_with_its_size():
    samples = motion()
    before = external_torque(MODEL, samples)
    std = np.nanmedian(before.std[:, 1])
    assert std == pytest.approx(np.hypot(NOISE, 0.3 * FRICTION), rel=1e-3)
    assert not before.significant.any() and np.abs(before.torque).max() < 3 * NOISE
    samples = motion(-5.0 * std)
    result = external_torque(MODEL, samples)
    since = samples.t - 1.0
    assert result.torque[since > 0.06, 1] == pytest.approx(-5.0 * std, abs=3 * NOISE)
    assert not result.significant[since < -1e-9].any()
    assert result.significant[since > 0.05 - 1e-9, 1].all() and not result.significant[:, 0].any()


def test_friction_of_a_joint_at_rest_is_no_push():
    samples = motion(push=-2.0 * FRICTION, speed=0.0)
    result = external_torque(MODEL, samples)
    assert not result.significant.any()
    assert np.nanmin(result.std[:, 1]) > FRICTION > 10 * np.nanmax(result.std[:, 0])
    assert external_torque(MODEL, motion(push=-6.0 * FRICTION, speed=0.0)).significant[:, 1].any()


def test_outside_of_the_trained_range_nothing_is_significant():
    samples = motion(push=50.0, speed=0.6, start=0.0)
    result = external_torque(MODEL, samples)
    outside = samples.q[:, 1] > 1.13
    assert np.isnan(result.std[outside]).all() and not result.significant[outside].any()
    assert result.significant[(samples.q[:, 1] < 1.05) & (samples.t > 0.1), 1].all()


def test_a_gap_or_a_clock_set_back_begins_a_new_window():
    observer, samples = ExternalTorqueObserver(MODEL), motion()

    def add(k, t):
        return observer.add(t, samples.q[k], samples.qd[k], samples.tau[k])

    assert [add(k, 0.01 * k) is None for k in range(6)] == [True] * 4 + [False] * 2
    assert add(6, 0.3) is None
    assert [add(k, 0.3 + 0.01 * k) is None for k in range(1, 5)] == [True] * 3 + [False]
    assert add(5, 0.1) is None and add(6, 0.11) is None


def test_at_1_khz_a_result_comes_200_times_a_second():
    observer = ExternalTorqueObserver(MODEL)
    zero = np.zeros(2)
    results = [observer.add(0.001 * k, zero, zero, zero) for k in range(1000)]
    assert 185 <= sum(result is not None for result in results) <= 200


def test_effects_that_need_earlier_samples_are_named():
    assert ExternalTorqueObserver(model(COULOMB, DRIFT)).left_out == ('torque_drift:a',)
    assert ExternalTorqueObserver(MODEL).left_out == ()


def test_an_effect_of_another_version_is_left_out():
    other = AppliedEffect('coulomb_friction', 'a', {'width': 0.002},
                          {'F_x': Value(1.0, 'N·m', (0.9, 1.1))})
    missing = AppliedEffect('not_installed', 'a', {}, {'x': Value(1.0, '', (0.9, 1.1))})
    with_others, samples = model(COULOMB, other, missing), motion(-5.0)
    for result in (external_torque(with_others, samples), external_torque(MODEL, samples)):
        np.testing.assert_array_equal(result.torque, external_torque(MODEL, samples).torque)


@pytest.mark.parametrize('name', [each.name for each in fields(ExternalTorqueOptions)])
@pytest.mark.parametrize('value', [0.0, -1.0, float('nan'), float('inf')])
def test_options_that_cannot_be_are_refused(name, value):
    with pytest.raises(OptionError, match=f'{name} is'):
        ExternalTorqueOptions(**{name: value})


def test_samples_of_another_arm_are_refused():
    with pytest.raises(ModelMismatchError):
        external_torque(MODEL, JointSamples.single_run(
            ('x', 'y'), np.arange(2.0), *np.zeros((3, 2, 2))))
