"""Effects from pose and speed alone: equal to the library."""

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.predict import effect_torque, LiveEffects
from gravity_comp_ros.effects.registry import library_effects
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion
import numpy as np
import pytest

WIDTH = 0.005


def effect(name, joint, setting=None, **coefficients):
    return AppliedEffect(name, joint, setting or {},
                         {k: Value(x, '', (x, x)) for k, x in coefficients.items()})


EFFECTS = (effect('coulomb_friction', 'a', {'width': WIDTH}, F_c=2.0),
           effect('viscous_friction', 'a', F_v=10.0),
           effect('coulomb_friction', 'b', {'distance': 0.02}, F_c=2.0),
           effect('stribeck_friction', 'b', {'speed': 0.03, 'width': WIDTH}, F_s=1.0),
           effect('asymmetric_friction', 'b', {'ramp': 0.02}, F_a=0.3),
           effect('load_dependent_friction', 'b', {'width': WIDTH}, mu=0.1),
           effect('coupled_friction', 'a', {'partner': 2.0, 'sign': 1.0, 'distance': 0.03},
                  F_k=0.7),
           effect('torque_offset', 'a', b=-0.4),
           effect('joint_spring', 'b', {'centre': 0.2, 'overtones': 0.0}, k=5.0, m=0.3),
           effect('torque_ripple', 'a', {'k': 12.0, 'harmonics': 1.0}, a=0.1, b=0.2),
           effect('torque_ripple', 'b', {'k': 12.0, 'harmonics': 2.0}, a_1=0.1, a_2=0.2, b_1=0.3,
                  b_2=-0.1),
           effect('asymmetric_friction', 'b', {'distance': 0.02, 'skew': 0.4}, F_a=0.5),
           effect('joint_flexibility', 'b', c=0.03), effect('time_delay', 'a', T=0.2))


def model(effects):
    """Return tau = (8 sin q_a, 3 sin q_b) plus effects."""
    torques = tuple(Expansion(np.array([k]), np.array([w])) for k, w in ((3, 8.0), (1, 3.0)))
    return GravityModel(
        ('a', 'b'), 'per_joint', torques, None, np.full(2, 0.1),
        Coverage(np.full(2, -1.0), np.full(2, 1.0), 100),
        applied=Applied(effects))


@pytest.mark.parametrize('number', range(len(EFFECTS)))
def test_the_torque_is_that_of_the_library(number):
    """Along a path without encoder noise, also where friction has a memory."""
    built = model((EFFECTS[number],))
    t = 0.1 * np.arange(60)
    q = np.column_stack([0.5 * np.sin(t), 0.4 * np.cos(1.3 * t)])
    qd = np.column_stack([0.5 * np.cos(t), -0.52 * np.sin(1.3 * t)])
    samples = JointSamples.single_run(['a', 'b'], t, q, qd, 0 * q)
    live = LiveEffects(built, built.applied.effects)
    result = [live.torque(q[k], qd[k], built.predict_one(q[k])) for k in range(60)]
    expected = effect_torque(built, samples)
    # A path without noise is rounded at its reversals by the search for them.
    assert np.abs(result - expected).max() < (0.03 if 'distance' in EFFECTS[number].setting
                                              else 1e-12)
    assert np.abs(result).max() > 0.05


@pytest.mark.parametrize('kind', ['start', 'recording'])
def test_of_values_by_recording_a_control_loop_and_other_recordings_have_the_mean(kind):
    recordings = {f'{kind}_{k}': 1e9 + 100.0 * k for k in (1, 2, 3)}
    built = model((effect('torque_offset', 'a', recordings, b=1.0, d_1=0.5, d_2=0.25),
                   effect('torque_gain', 'b', recordings, k=0.1, d_1=0.2, d_2=0.3)))
    zero, expected = np.zeros(2), [1.0, 0.1 * 10.0]
    live = LiveEffects(built, built.applied.effects)
    np.testing.assert_allclose(live.torque(zero, zero, np.array([0.0, 10.0])), expected)
    for start in (None, 2e9):
        samples = JointSamples.single_run(['a', 'b'], [0.0], *np.zeros((3, 1, 2)), start=start)
        other = effect_torque(built, samples, np.array([[0.0, 10.0]]))
        np.testing.assert_allclose(other, [expected])


def test_friction_with_a_memory_persists_at_rest_in_spite_of_encoder_noise():
    built = model((EFFECTS[2],))
    live, rng = LiveEffects(built, built.applied.effects), np.random.default_rng(0)
    zero = np.zeros(2)
    for angle in np.linspace(0.0, 0.2, 50):
        live.torque(np.array([0.0, angle]), zero, zero)
    noisy = [live.torque(np.array([0.0, 0.2 + x]), zero, zero)[1]
             for x in rng.normal(0.0, 1e-4, 5000)]
    assert min(noisy) > 1.8


def test_an_effect_of_another_version_is_left_out_before_the_loop(monkeypatch):
    for one in (effect('stribeck_friction', 'a', F_s=1.0),
                effect('coulomb_friction', 'a', {'width': WIDTH}, F_x=1.0),
                effect('not_installed', 'a', x=1.0)):
        result = LiveEffects(model((one,)), [one, EFFECTS[1]])
        assert result.targets == ('viscous_friction:a',)
        assert one.name in result.problem
    # So is an effect whose code fails: the control loop must not end.
    def fails(*_):
        raise ZeroDivisionError('no speed')

    monkeypatch.setattr(library_effects()['viscous_friction'], 'torque', fails)
    result = LiveEffects(model(EFFECTS[:2]), EFFECTS[:2])
    assert result.targets == ('coulomb_friction:a',) and 'no speed' in result.problem
    # Effects with a history are left out.
    drift = effect('torque_drift', 'a', {'origin': 0.0, 'time': 100.0}, r=1.0, b=2.0)
    result = LiveEffects(model((drift,)), [drift])
    assert result.targets == () and result.left_out == ('torque_drift:a',)
