"""Effects from pose and speed alone: equal to the library, limited for compensation."""

from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.predict import effect_torque
from gravity_comp_ros.errors import ModelMismatchError, OptionError
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.expansion import Expansion
from gravity_comp_ros.node.realtime_effects import (
    COMPENSABLE, compensable, CompensateOptions, INSTANTANEOUS, InstantEffects)
import numpy as np
import pytest

WIDTH = 0.005


def effect(name, joint, setting=None, **coefficients):
    return AppliedEffect(name, joint, setting or {},
                         {k: Value(x, '', (x, x)) for k, x in coefficients.items()})


EFFECTS = (effect('coulomb_friction', 'a', F_c=2.0), effect('viscous_friction', 'a', F_v=10.0),
           effect('stribeck_friction', 'b', {'speed': 0.03}, F_s=1.0),
           effect('asymmetric_friction', 'b', F_a=0.3),
           effect('load_dependent_friction', 'b', mu=0.1),
           effect('torque_offset', 'a', b=-0.4),
           effect('joint_spring', 'b', {'centre': 0.2, 'overtones': 0.0}, K=5.0),
           effect('torque_ripple', 'a', {'k': 12.0}, a=0.1, b=0.2))


def model(effects):
    """Return tau = (8 sin q_a, 3 sin q_b) plus effects."""
    torques = tuple(Expansion(np.array([k]), np.array([w])) for k, w in ((3, 8.0), (1, 3.0)))
    return GravityModel(
        ('a', 'b'), 'per_joint', torques, None, np.full(2, 0.1),
        Coverage(np.full(2, -1.0), np.full(2, 1.0), 100),
        applied=Applied(effects, {'width': np.full(2, WIDTH), 'hold': np.zeros(2)}))


def symbols_of(effects):
    """Return the effects with the symbols that the library gives their coefficients."""
    from gravity_comp_ros.effects.registry import all_effects
    fixed = []
    for one in effects:
        names = [c.symbol for c in all_effects()[one.name].coefficients]
        values = list(one.coefficients.values())
        fixed.append(AppliedEffect(one.name, one.joint, one.setting, dict(zip(names, values))))
    return tuple(fixed)


@pytest.mark.parametrize('number', range(len(EFFECTS)))
def test_the_torque_is_that_of_the_library(number):
    built = model(symbols_of((EFFECTS[number],)))
    rng = np.random.default_rng(number)
    q, qd = rng.uniform(-1, 1, (40, 2)), rng.uniform(-0.1, 0.1, (40, 2))
    samples = JointSamples.single_run(['a', 'b'], 0.1 * np.arange(40), q, qd, 0 * q)
    instant = InstantEffects(built)
    result = [instant.torque(q[k], qd[k], built.predict_one(q[k])) for k in range(40)]
    np.testing.assert_allclose(result, effect_torque(built, samples), atol=1e-12)
    assert np.abs(result).max() > 0.05


def test_compensated_friction_is_a_fraction_and_smooth_at_rest():
    built = model(symbols_of(EFFECTS[:2]))
    sent = InstantEffects(built, ('coulomb_friction:a',),
                          CompensateOptions(fraction=0.5, speed=0.02, top_speed=0.1))
    assert sent.targets == ('coulomb_friction:a',)

    def at(speed):
        return sent.torque(np.zeros(2), np.array([speed, 0.0]), np.zeros(2))

    np.testing.assert_allclose(at(0.02), [0.5 * 2.0 * np.tanh(1.0), 0.0])
    np.testing.assert_allclose(at(0.0), [0.0, 0.0])
    np.testing.assert_allclose(at(-9.0), -at(9.0))


def test_speeds_are_clipped_to_the_trained_range():
    sent = InstantEffects(model(symbols_of(EFFECTS[1:2])), ('viscous_friction:a',),
                          CompensateOptions(fraction=1.0, top_speed=0.1))
    np.testing.assert_allclose(sent.torque(np.zeros(2), np.array([5.0, 0.0]), np.zeros(2)),
                               [1.0, 0.0])


def test_effects_with_history_are_left_out():
    drift = AppliedEffect('torque_drift', 'a', {'centre': 0.0}, {'c': Value(1.0, '', (0, 2))})
    result = InstantEffects(model((drift,)))
    assert result.targets == () and result.left_out == ('torque_drift:a',)


def test_an_effect_of_another_version_is_refused_before_the_loop():
    without_setting = symbols_of((effect('stribeck_friction', 'a', {}, F_s=1.0),))
    other_symbol = (effect('coulomb_friction', 'a', F_x=1.0),)
    for effects in (without_setting, other_symbol):
        with pytest.raises(ModelMismatchError, match='fit it again'):
            InstantEffects(model(effects))


def test_only_safe_effects_are_compensable():
    assert set(COMPENSABLE) < set(INSTANTANEOUS)
    assert compensable(['coulomb_friction:b', 'viscous_friction'], ('a', 'b')) == (
        'coulomb_friction:b', 'viscous_friction:a', 'viscous_friction:b')
    for name in ('inertia', 'time_delay:a', 'end_stop', 'torque_gain:b', 'torque_ripple:a'):
        with pytest.raises(OptionError, match='refused'):
            compensable([name], ('a', 'b'))
    with pytest.raises(OptionError, match='did you mean coulomb_friction'):
        compensable(['coulomb_fricton'], ('a', 'b'))


@pytest.mark.parametrize('change', [{'fraction': 1.1}, {'fraction': -0.1}, {'speed': 0.0},
                                    {'top_speed': float('nan')}])
def test_options_out_of_range(change):
    with pytest.raises(OptionError):
        CompensateOptions(**change)
