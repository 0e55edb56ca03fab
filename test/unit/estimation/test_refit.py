"""Joint refits of gravity and effects in every formulation, and predictions with effects."""

from dataclasses import replace
from functools import cache

from bench.shared.rough_links import COULOMB, JOINTS, NOISE, two_links, VISCOUS
from gravity_comp_ros.api.recording import Recording
from gravity_comp_ros.api.steps import add_to_model, fit_model
from gravity_comp_ros.data.gate import GateOptions, slow_samples
from gravity_comp_ros.data.samples import concatenate
from gravity_comp_ros.effects.periodic import TorqueRipple
from gravity_comp_ros.effects.predict import effect_torque, predict_torque
from gravity_comp_ros.effects.registry import requests
from gravity_comp_ros.estimation.estimate import estimate, FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.refit import refit
import numpy as np
import pytest


def thinned(*runs):
    """Return runs with one sample of four."""
    samples = concatenate(runs)
    return samples.select(np.arange(0, len(samples), 4))


SAMPLES = thinned(two_links(1), two_links(2))
FRICTION = ('coulomb_friction:shoulder', 'viscous_friction:shoulder')


@cache
def fitted(formulation='chain', samples=SAMPLES):
    return fit(slow_samples(samples).samples, FitOptions(formulation)).model


def added(model, *targets, samples=SAMPLES, **options):
    return refit(samples, model, requests(targets, model.joints), **options)


@cache
def rubbing():
    """Return the model with friction, and the report of its refit."""
    return added(fitted(), *FRICTION)


def values(model, target):
    effect = next(e for e in model.applied.effects if e.target == target)
    return {symbol: x.value for symbol, x in effect.coefficients.items()}


@pytest.mark.parametrize('formulation', ['per_joint', 'potential', 'chain'])
def test_a_refit_keeps_the_formulation(formulation):
    model = fitted(formulation)
    result = added(model, *FRICTION).model
    assert result.formulation == formulation and (result.chain is None) == (model.chain is None)
    if formulation == 'per_joint':
        assert result.energy is None
    else:
        q = two_links(9).q
        torque = np.column_stack([_slope(result, q, n) for n in range(2)])
        np.testing.assert_allclose(result.predict(q), torque, atol=1e-6)
        assert (result.predict_std(q) > 0.0).all()
    assert values(result, FRICTION[0])['F_c'] == pytest.approx(COULOMB, abs=0.05)
    assert values(result, FRICTION[1])['F_v'] == pytest.approx(VISCOUS, rel=0.1)


def _slope(model, q, joint):
    """Return d U / d q of a joint from energies: the torques must have a potential."""
    from gravity_comp_ros.models.sparse import dictionary
    step = np.zeros(q.shape[1])
    step[joint] = 1e-5
    energy = [dictionary.columns(x, model.energy.indices) @ model.energy.weights
              for x in (q - step, q + step)]
    return (energy[1] - energy[0]) / 2e-5


def test_nonlinear_parameters_are_fitted_to_training_data():
    # 0.8 N·m more at creeping speed, which decays at about 0.03 rad/s.
    extra = 0.8 * np.exp(-(SAMPLES.qd[:, 0] / 0.03) ** 2) * np.tanh(SAMPLES.qd[:, 0] / 0.005)
    tau = SAMPLES.tau + np.column_stack([extra, np.zeros(len(extra))])
    samples = replace(SAMPLES, tau=tau)
    model = fitted(samples=samples)
    result = added(model, *[e.target for e in model.fitted.effects if e.joint == 'shoulder'],
                   samples=samples)
    effect = next(e for e in result.model.applied.effects if e.name == 'stribeck_friction')
    assert effect.setting['speed'] == pytest.approx(0.03, rel=0.35)
    assert effect.coefficients['F_s'].value == pytest.approx(0.8, rel=0.25)
    # The width of the friction sign is identified in spite of Stribeck friction.
    assert result.errors['shoulder'].after < 1.5 * NOISE


def test_errors_before_and_after_are_held_out():
    # An absent effect must not seem to help; errors on fitted samples would always fall.
    error = added(fitted(), 'viscous_friction:elbow', 'torque_ripple:elbow',
                  samples=concatenate([two_links(10), two_links(30)])).errors['elbow']
    assert error.after > 0.97 * error.before


def test_unused_samples_have_no_influence():
    use = SAMPLES.runs == 0
    spoilt = replace(SAMPLES, tau=np.where(use[:, None], SAMPLES.tau, 0.0))
    # The direction of motion uses all samples; everything else only those in use.
    a = added(fitted(), 'torque_offset:elbow', samples=SAMPLES, use=use).model
    b = added(fitted(), 'torque_offset:elbow', samples=spoilt, use=use).model
    assert values(a, 'torque_offset:elbow') == pytest.approx(
        values(b, 'torque_offset:elbow'), rel=1e-9)
    np.testing.assert_allclose(a.energy.weights, b.energy.weights, rtol=1e-6, atol=1e-9)


def test_the_samples_of_the_fit_are_fitted():
    samples = two_links(1, 240)
    for gate in (GateOptions(0.1), None):
        recording = Recording(samples, gate)
        joint = fit_model(recording, FitOptions('chain'), [FRICTION[0]])[1]
        limit = np.inf if gate is None else gate.max_speed
        n_slow = int((np.abs(samples.qd) <= limit).all(axis=1).sum())
        again = add_to_model(fitted(), recording, [FRICTION[0]])
        assert joint.n_samples == again.n_samples == n_slow
        assert gate is None or 120 < n_slow < 240


def test_a_forced_effect_that_the_samples_do_not_excite_is_left_out(monkeypatch):
    drift, ripple = ('friction_drift', 0), ('torque_ripple', 0)
    monkeypatch.setattr(TorqueRipple, 'settings', lambda *_: [])
    regression = estimate(two_links(3, 400), forced=frozenset({drift, ripple})).regression
    assert not {drift, ripple} & {term.key for term in regression.terms}
    assert {drift, ripple} <= set(regression.candidates.untestable)


def test_an_effect_that_a_recording_does_not_excite_is_kept():
    result = rubbing().model
    still = two_links(5, one_way=True)
    later = added(result, 'torque_offset:elbow', samples=still)
    assert FRICTION[0] in {effect.target for effect in later.model.applied.effects}
    # No other term absorbs its torque.
    assert later.errors['elbow'].after < 1.25 * NOISE


def test_predictions_are_independent_of_measured_torque():
    result = added(fitted(), *FRICTION, 'torque_offset:elbow').model
    samples = two_links(7)
    blind = replace(samples, tau=np.zeros_like(samples.tau))
    np.testing.assert_array_equal(predict_torque(result, samples), predict_torque(result, blind))
    np.testing.assert_allclose(predict_torque(result, samples) - result.predict(samples.q),
                               effect_torque(result, samples))
    turned = samples.joints(JOINTS[::-1])
    np.testing.assert_array_equal(predict_torque(result, turned), predict_torque(result, samples))
