"""The estimator: friction fitted with gravity, outliers, correct reported errors."""


from bench.shared.campaign import campaign
from bench.shared.rough_links import two_links
from bench.shared.serial_arms import worst
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.effects.predict import fitted_torque
from gravity_comp_ros.effects.registry import requests
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.estimation.robust import outliers
from gravity_comp_ros.evaluation.compare import compare
from gravity_comp_ros.simulation import arms, motions
import numpy as np
import pytest

NOISE, COULOMB, VISCOUS = 0.1, 0.8, 4.0
ARM = arms.iiwa7()
WIDE = np.random.default_rng(1).uniform(ARM.lower, ARM.upper, (500, 7))


def rms(x):
    return np.sqrt((x ** 2).mean(axis=0))


def sizes(model, name):
    """Return the first coefficient of a fitted effect, by joint."""
    return {effect.joint: next(iter(effect.coefficients.values()))
            for effect in model.fitted.effects if effect.name == name}


def std(value):
    return (value.ci95[1] - value.ci95[0]) / (2.0 * 1.96)


@pytest.fixture(scope='module')
def samples():
    """Return Yu 2022, Eq. (17), with friction on every joint, which is not conservative."""
    motion = motions.eq17(rate=2.5)
    tau = arms.gravity_torque(ARM, motion.q)
    tau += COULOMB * motion.qd / np.hypot(motion.qd, 0.002) + VISCOUS * motion.qd
    tau += NOISE * np.random.default_rng(0).normal(size=tau.shape)
    return JointSamples.single_run(ARM.joints, motion.t, motion.q, motion.qd, tau)


@pytest.fixture(scope='module')
def result(samples):
    return fit(samples)


def test_gravity_does_not_absorb_friction(result):
    model = result.model
    assert model.formulation == 'chain' and worst(model, ARM, WIDE) < 0.15
    coulomb, viscous = sizes(model, 'coulomb_friction'), sizes(model, 'viscous_friction')
    # Over this range of speeds, grease may explain the same: then both are named.
    tied = {ARM.joints[joint] for (name, joint), others in
            result.estimate.regression.alternatives.items()
            if name == 'degressive_friction' and ('viscous_friction', joint) in others}
    assert set(coulomb) == set(ARM.joints) == set(viscous) | tied and len(viscous) >= 5
    for joint in set(coulomb) - tied:
        size = coulomb[joint]
        assert size.value == pytest.approx(COULOMB, abs=max(4 * std(size), 0.02))
    for size in viscous.values():
        assert size.value == pytest.approx(VISCOUS, abs=4 * std(size))


def test_friction_is_not_predicted(result, samples):
    # The prediction excludes fitted effects, and the reported error includes them.
    residual = samples.tau - result.model.predict(samples.q)
    assert rms(residual).min() > 0.7
    noise = residual - fitted_torque(result.model, samples)
    assert rms(noise) == pytest.approx(np.full(7, NOISE), rel=0.2)
    assert result.model.residual_std == pytest.approx(np.full(7, NOISE), rel=0.2)
    # Fit and comparison report the same errors.
    joints = compare(result.model, samples).joints
    for name, rmse in result.report.rmse.items():
        assert joints[name].rmse == pytest.approx(rmse, rel=1e-9)
    assert result.model.noise == pytest.approx([joints[name].rmse for name in ARM.joints])


@pytest.mark.parametrize('formulation', ['chain', *campaign('potential')])
def test_noise_after_an_addition_is_the_error_of_the_prediction(formulation):
    data = two_links(1)
    model = fit(data, FitOptions(formulation)).model
    effects = requests(['coulomb_friction:shoulder', 'viscous_friction:shoulder'], data.names)
    refitted = refit(data, model, effects).model
    slow = (np.abs(data.qd) <= 0.15).all(axis=1)
    joints = compare(refitted, data.select(slow), data).joints
    assert refitted.noise == pytest.approx([joints[name].rmse for name in data.names], rel=1e-6)
    assert refitted.noise[0] < 0.1 < model.noise[0]


def test_outliers_of_two_runs_are_reported_with_both(samples):
    half = samples.n_samples // 2
    residual = np.random.default_rng(0).normal(size=samples.tau.shape)
    residual[[50, half + 10], 3] = 100.0
    t = np.concatenate([samples.t[:half], samples.t[:samples.n_samples - half]])
    two = JointSamples(samples.names, t, samples.q, samples.qd, samples.tau,
                       (np.arange(samples.n_samples) >= half).astype(int), ('one', 'two'))
    text = str(outliers(two, np.ones(len(two), dtype=int), residual)['iiwa_joint_4'])
    assert text == f'from {t[50]:.1f} s of one to {t[half + 10]:.1f} s of two'
