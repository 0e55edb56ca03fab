"""Few-sample update after a payload change."""

from bench.shared.serial_arms import samples_of, worst
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import FitError, ModelMismatchError, OptionError
from gravity_comp_ros.estimation.chain_update import _spread
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.update import reversal_std, update, UpdateOptions
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.models.uncertainty import ChainUncertainty
from gravity_comp_ros.simulation import arms, motions
import numpy as np
import pytest

NOISE = 0.1
LATER = motions.eq17(start=100.0).q


def after(arm, q, seed: int = 1) -> JointSamples:
    return samples_of(q, arms.gravity_torque(arm, q), NOISE, seed, arm.joints)


@pytest.fixture(scope='module')
def old():
    """Return the iiwa without payload and its model from Yu 2022, Eq. (17)."""
    arm, q = arms.iiwa7(), motions.eq17().q
    samples = samples_of(q, arms.gravity_torque(arm, q), NOISE, 0, arm.joints)
    return arm, fit(samples, FitOptions('chain')).model


@pytest.fixture(scope='module')
def wide():
    arm = arms.iiwa7()
    return np.random.default_rng(1).uniform(arm.lower, arm.upper, (500, 7))


@pytest.mark.parametrize('com, count, on_motion, over_range', [
    ((0.0, 0.0, 0.1), 50, 0.05, 0.2), ((0.02, 0.03, 0.1), 25, 0.1, 0.3)])
def test_two_kilograms_from_seconds_of_motion(old, wide, com, count, on_motion, over_range):
    arm = arms.with_payload(old[0], arms.Payload(2.0, com))
    result = update(old[1], after(arm, LATER[:count]))
    assert worst(old[1], arm, LATER) > 5.0
    assert worst(result.model, arm, LATER) <= on_motion
    assert worst(result.model, arm, wide) <= over_range


def test_band_after_an_update(old, wide):
    arm = arms.with_payload(old[0], arms.Payload(2.0, (0.02, 0.03, 0.1)))
    model = update(old[1], after(arm, LATER[:50])).model
    for q in (LATER, wide):
        tau = after(arm, q, seed=9).tau
        inside = np.abs(tau - model.predict(q)) <= 1.96 * np.hypot(model.predict_std(q),
                                                                   model.noise)
        assert inside.mean() >= 0.9


def test_a_payload_is_added_and_removed(old, wide):
    arm, model = old
    loaded = arms.with_payload(arm, arms.Payload(2.0, (0.0, 0.0, 0.1)))
    loaded_result = update(model, after(loaded, LATER[:50]))
    without = update(loaded_result.model, after(arm, LATER[50:100], 2))
    assert worst(without.model, arm, LATER) <= 0.1
    assert worst(without.model, arm, wide) <= 0.3
    assert len(without.model.provenance['updates']) == 2


def test_no_change_changes_little(old, wide):
    arm, model = old
    result = update(model, after(arm, LATER[:50]))
    assert worst(result.model, arm, wide) <= 1.5 * worst(model, arm, wide)
    assert result.report.changed == {}


def test_report_contains_the_torque_of_the_payload(old, tmp_path):
    arm = arms.with_payload(old[0], arms.Payload(2.0, (0.0, 0.0, 0.1)))
    result = update(old[1], after(arm, LATER[:50]))
    report = result.report
    expected = (arms.gravity_torque(arm, LATER[:50])
                - arms.gravity_torque(old[0], LATER[:50])).mean(axis=0)
    assert list(report.effect_mean.values()) == pytest.approx(expected, abs=0.1)
    assert report.rmse['iiwa_joint_2'] < 0.2 < report.rmse_before['iiwa_joint_2']
    assert report.solver.converged and report.n_samples == 50
    assert {name.split()[0] for name in report.changed} <= set(arm.joints)
    save_model(tmp_path / 'm.json', result.model)
    loaded = load_model(tmp_path / 'm.json')
    np.testing.assert_array_equal(loaded.predict_std(LATER), result.model.predict_std(LATER))


def test_an_unidentified_axis_is_identified_with_the_payload(old, wide):
    # The axis of joint 7 without payload has no moment; that of the payload identifies it.
    arm = arms.with_payload(old[0], arms.Payload(2.0, (0.05, 0.0, 0.1)))
    moments, std = old[1].chain.moments[6], np.sqrt(np.diag(old[1].uncertainty.covariance)[-2:])
    assert (np.abs(moments) < 3.0 * std).all() and np.abs(moments).max() < 0.05
    model = update(old[1], after(arm, LATER[:50])).model
    error = (model.predict(wide) - arms.gravity_torque(arm, wide))[:, 6]
    assert np.sqrt((error ** 2).mean()) <= 0.1


def test_an_update_warns_of_a_large_uncertainty(old):
    loaded = arms.with_payload(old[0], arms.Payload(2.0, (0.02, 0.03, 0.1)))
    few = update(old[1], after(loaded, LATER[:12]))
    assert any('may be off by' in message for message in few.report.warnings)
    assert update(old[1], after(loaded, LATER[:100])).report.warnings == ()


def test_update_of_a_potential(old):
    arm, q = old[0], motions.eq17().q
    samples = samples_of(q, arms.gravity_torque(arm, q), NOISE, 0, arm.joints)
    model = fit(samples, FitOptions('potential')).model
    loaded = arms.with_payload(arm, arms.Payload(2.0, (0.0, 0.0, 0.1)))
    result = update(model, after(loaded, LATER[:100]))
    assert result.model.formulation == 'potential'
    np.testing.assert_array_equal(result.model.energy.indices, model.energy.indices)
    assert worst(result.model, loaded, LATER[:100]) <= 0.3 < worst(model, loaded, LATER[:100])
    assert np.isfinite(result.model.predict_std(LATER)).all()


def test_invalid_updates_are_refused(old):
    arm, model = old
    with pytest.raises(FitError, match='an update needs 10'):
        update(model, after(arm, LATER[:9]))
    others = samples_of(LATER[:50], np.zeros((50, 7)), 0.1, 0, tuple('abcdefg'))
    with pytest.raises(ModelMismatchError, match='no joint'):
        update(model, others)
    q = motions.eq17().q
    per_joint = fit(samples_of(q, arms.gravity_torque(arm, q), NOISE, 0, arm.joints),
                    FitOptions('per_joint')).model
    with pytest.raises(ModelMismatchError, match='per_joint'):
        update(per_joint, after(arm, LATER[:50]))


@pytest.mark.parametrize('options', [{'min_samples': 1}, {'old_noise': 0.0},
                                     {'old_noise': float('nan')}])
def test_options_are_checked(options):
    with pytest.raises(OptionError, match='update'):
        UpdateOptions(**options)


def test_differences_between_hypotheses_are_part_of_the_uncertainty(old, wide):
    """Two equally probable chains whose last axes differ by 0.1 rad, without other uncertainty."""
    chain = old[1].chain
    loaded = chain.moved(np.concatenate([np.zeros(14), np.full(14, 2.0)]))
    step = np.zeros(28)
    step[12] = 0.1
    other = loaded.moved(step)
    torques = np.array([loaded.torque(wide), other.torque(wide)])
    covariance = _spread(loaded, wide, torques, np.full(2, 0.5))
    std = ChainUncertainty(loaded, covariance).std(wide)
    difference = np.abs(other.torque(wide) - loaded.torque(wide))
    np.testing.assert_allclose(std, difference / np.sqrt(2.0), atol=0.05 * difference.max())
    assert difference.max() > 0.1
    single = _spread(loaded, wide, torques[:1], np.ones(1))
    np.testing.assert_allclose(single, 0.0, atol=1e-12)


NO_ENERGY = Expansion(np.zeros(0, dtype=np.int64), np.zeros(0))


@pytest.mark.parametrize('law', [{'width': 0.02}, {'ramp': 0.02}])
def test_friction_is_uncertain_near_reversals_only(law):
    speeds = np.array([0.0, 0.02, 0.1, -0.02])
    samples = JointSamples.single_run(('a', 'b'), np.arange(4.0), np.zeros((4, 2)),
                                      np.column_stack([speeds, speeds]), np.zeros((4, 2)))
    friction = AppliedEffect('coulomb_friction', 'a', law, {
        'F_c': Value(3.0, 'N·m', (2.8, 3.2))})
    model = GravityModel(('a', 'b'), 'potential', (NO_ENERGY, NO_ENERGY), NO_ENERGY, np.zeros(2),
                         Coverage(np.zeros(2), np.zeros(2), 4), fitted=Applied((friction,)))
    std = reversal_std(model, samples)
    # The speed of the reversal changes by the factor 1.8 with the payload.
    slow, quick = (1.0 / 1.8, 1.0) if 'ramp' in law else (np.tanh(1.0 / 1.8), np.tanh(1.8))
    assert std[1, 0] == std[3, 0] == pytest.approx(1.5 * (quick - slow))
    assert std[0, 0] == 0.0 and std[2, 0] < 0.05 and not std[:, 1].any()
