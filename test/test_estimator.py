"""The one estimator: friction stays beside gravity, outliers are set aside, numbers are true."""

from dataclasses import replace

from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.nuisance_columns import nuisance_torque
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.evaluation.compare import compare
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.noise import NoiseOptions
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np
import pytest
from rough_links import two_links

NOISE, COULOMB, VISCOUS = 0.1, 0.8, 4.0
ARM = arms.iiwa7()
WIDE = np.random.default_rng(1).uniform(ARM.lower, ARM.upper, (500, 7))


def eq17(seed=0, start=0.0, duration=100.0, arm=ARM, friction=1.0):
    """Return Yu 2022, Eq. (17) with friction on every joint that no smooth energy can have."""
    motion = motions.eq17(start=start, duration=duration)
    tau = arms.gravity_torque(arm, motion.q)
    tau = tau + friction * (COULOMB * motion.qd / np.hypot(motion.qd, 0.002)
                            + VISCOUS * motion.qd)
    tau = tau + NOISE * np.random.default_rng(seed).normal(size=tau.shape)
    return JointSamples.single_run(ARM.joints, motion.t, motion.q, motion.qd, tau)


def gravity_error(model, q=WIDE, arm=ARM):
    return np.sqrt(((model.predict(q) - arms.gravity_torque(arm, q)) ** 2).mean(axis=0)).max()


def rms(x):
    return np.sqrt((x ** 2).mean(axis=0))


@pytest.fixture(scope='module')
def samples():
    return eq17()


@pytest.fixture(scope='module')
def result(samples):
    return fit(samples)


def test_friction_is_not_taken_for_gravity(result):
    model = result.model
    assert model.formulation == 'chain' and gravity_error(model) < 0.15
    coulomb, viscous = model.nuisance.of('coulomb_friction'), model.nuisance.of(
        'viscous_friction')
    assert set(coulomb) == set(ARM.joints)
    for term in coulomb.values():
        assert term.value == pytest.approx(COULOMB, abs=max(4 * term.std, 0.02))
    for term in viscous.values():
        assert term.value == pytest.approx(VISCOUS, abs=4 * term.std)


def test_friction_is_not_predicted(result, samples):
    # What is fitted beside gravity is neither in the prediction nor hidden from the error.
    left = samples.tau - result.model.predict(samples.q)
    assert rms(left).min() > 0.7
    rest = left - nuisance_torque(result.model.nuisance, samples)
    assert rms(rest) == pytest.approx(np.full(7, NOISE), rel=0.2)
    assert result.model.nuisance.noise == pytest.approx(np.full(7, NOISE), rel=0.2)


def test_what_a_fit_reports_is_what_compare_finds(result, samples):
    found = compare(result.model, samples).joints
    for name, rmse in result.report.rmse.items():
        assert found[name].rmse == pytest.approx(rmse, rel=1e-9)
    assert result.model.noise == pytest.approx([found[name].rmse for name in ARM.joints])


@pytest.mark.parametrize('formulation', ['chain', 'potential'])
def test_errors_after_an_addition_are_those_of_the_model_as_it_is(formulation):
    data = two_links(1)
    model = fit(data, FitOptions(formulation)).model
    made = refit(data, model, requests(['coulomb_friction:shoulder', 'viscous_friction:shoulder'],
                                       data.names)).model
    slow = (np.abs(data.qd) <= 0.15).all(axis=1)
    found = compare(made, data.select(slow), data).joints
    assert made.noise == pytest.approx([found[name].rmse for name in data.names], rel=1e-6)
    assert made.noise[0] < 0.1 < model.noise[0]


def test_an_update_carries_friction_over(result):
    loaded = arms.with_payload(ARM, arms.Payload(2.0, (0.02, 0.03, 0.1)))
    new = eq17(5, 100.0, 15.0, loaded)
    found = update(result.model, new)
    q = motions.eq17(start=120.0).q
    assert gravity_error(result.model, q, loaded) > 5.0
    assert gravity_error(found.model, q, loaded) < 0.6
    assert found.model.nuisance.terms == result.model.nuisance.terms
    errors = rms(new.tau - found.model.predict(new.q))
    assert list(found.report.rmse.values()) == pytest.approx(errors.tolist())


def test_a_brake_that_grips_is_set_aside_and_named(samples):
    tau = samples.tau.copy()
    tau[200:210, 3] += 25.0
    tau[77, 1] -= 80.0
    found = fit(replace(samples, tau=tau))
    assert gravity_error(found.model) < 0.2
    gone = found.report.set_aside
    assert gone['iiwa_joint_4'].n == 10 and gone['iiwa_joint_2'].n >= 1
    assert gone['iiwa_joint_4'].first == pytest.approx(samples.t[200])
    assert any('set aside as outliers: 10 samples of iiwa_joint_4' in line
               for line in found.report.warnings)


def test_velocities_that_contradict_positions_are_replaced(samples):
    found = fit(replace(samples, qd=20.0 * samples.qd))
    assert gravity_error(found.model) < 0.3
    assert 'velocity contradicts position' in found.report.warnings[0]


def test_the_description_of_another_arm_is_not_used(samples):
    wrong = Geometry(ARM.joints, np.tile(np.eye(3), (7, 1, 1)), np.zeros((7, 3)), 'tool',
                     np.eye(3))
    found = fit(samples, FitOptions(geometry=wrong))
    assert gravity_error(found.model) < 0.2
    assert any('the description is not used' in line for line in found.report.warnings)
    assert not found.report.known_axes


def test_a_model_file_keeps_the_terms_beside_gravity(result, tmp_path):
    save_model(tmp_path / 'm.json', result.model)
    again = load_model(tmp_path / 'm.json')
    assert again.nuisance.terms == result.model.nuisance.terms
    np.testing.assert_array_equal(again.nuisance.width, result.model.nuisance.width)


def test_long_recordings_cost_no_more_than_short_ones():
    t = np.linspace(0.0, 100.0, 20000)
    short = eq17()
    q = np.stack([np.interp(t, short.t, column) for column in short.q.T], axis=1)
    qd = np.stack([np.interp(t, short.t, column) for column in short.qd.T], axis=1)
    tau = arms.gravity_torque(ARM, q) + NOISE * np.random.default_rng(0).normal(size=q.shape)
    found = fit(JointSamples.single_run(ARM.joints, t, q, qd, tau))
    assert found.report.n_samples == 20000 and found.report.n_fitted <= 1001
    assert gravity_error(found.model) < 0.1


def test_a_few_strokes_add_to_what_slow_motion_has_shown():
    # Strokes start and stop at up to 0.6 rad/s^2: 3 N·m of inertia in some samples, at low speed.
    arm = arms.iiwa7()
    slow = motions.multisine(0.5 * arm.lower, 0.5 * arm.upper, arm.max_speed, 7,
                             motions.MultisineOptions(max_speed=0.15), 100.0, 4.0)
    strokes = motions.multisine(0.05 * arm.lower, 0.05 * arm.upper, arm.max_speed, 8,
                                motions.MultisineOptions(band=1.2, max_speed=0.14), 15.0, 20.0)
    parts = [synthesise(arm, motion, SynthesisOptions(NoiseOptions(absolute=0.1), k))
             for k, motion in enumerate((slow, strokes))]
    poses = np.random.default_rng(0).uniform(0.4 * arm.lower, 0.4 * arm.upper, (300, 7))
    model = fit(concatenate(parts), FitOptions('chain')).model
    wrong = model.predict(poses) - arms.gravity_torque(arm, poses)
    assert np.sqrt((wrong ** 2).mean(axis=0)).max() < 0.1
