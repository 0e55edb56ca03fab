"""Rigid-body dynamics with known axes, compared with Pinocchio's recursive Newton-Euler."""

from dataclasses import replace

from bench.cases.arms import generated_arm
from bench.shared.campaign import campaign
from bench.shared.fast_arms import drawn, moved, of_motion, recording, worst
from bench.shared.serial_arms import geometry_of
from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.diagnosis.diagnose import diagnose
from gravity_comp_ros.effects.predict import motion_of
from gravity_comp_ros.effects.request import known_effect, requests
from gravity_comp_ros.errors import DataError, ModelFileError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.estimation.refit import refit
from gravity_comp_ros.models.kinematic.nominal_arm import nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import inverse_dynamics, regressor
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.arms import iiwa7
from gravity_comp_ros.simulation.disturbances.friction import Friction, LuGre
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
from hypothesis import given, strategies as st
import numpy as np
import pytest

G = STANDARD_GRAVITY


def parameters_of(arm):
    """Return Pinocchio's inertias in the order of this package."""
    parameters = []
    for inertia in list(arm.model.inertias)[1:]:
        m, mx, my, mz, xx, xy, yy, xz, yz, zz = inertia.toDynamicParameters()
        parameters += [m, mx, my, mz, xx, xy, xz, yy, yz, zz]
    return np.array(parameters)


@given(st.integers(0, 10 ** 6), st.integers(1, 8))
def test_the_regressor_agrees_with_newton_euler(seed, n):
    # Every other pair of seeds has a tilted base, which the regressor does not model.
    arm = generated_arm(4 * (seed // 4), n)
    q, qd, qdd = drawn(n, 5, seed)
    theta, geometry = parameters_of(arm), geometry_of(arm)
    gravity = abs(float(arm.model.gravity.linear[2]))
    whole = regressor(geometry, q, qd, qdd, gravity) @ theta
    assert whole == pytest.approx(arms.inverse_dynamics(arm, q, qd, qdd), abs=1e-9)
    assert inverse_dynamics(geometry, q, qd, qdd, theta, gravity) == pytest.approx(whole, abs=1e-9)
    motion = regressor(geometry, q, qd, qdd) @ theta
    assert motion == pytest.approx(of_motion(arm, q, qd, qdd), abs=1e-9)


def gravity_of(arm, seed=0):
    """Return a chain on the arm's axes, fitted to gravity alone."""
    q = np.random.default_rng(seed).uniform(arm.lower, arm.upper, (400, arm.n_joints))
    samples = JointSamples.single_run(arm.joints, 0.2 * np.arange(len(q)), q, np.zeros_like(q),
                                      arms.gravity_torque(arm, q))
    return fit(samples, FitOptions('chain', geometry=geometry_of(arm))).model


@pytest.mark.parametrize('seed', [0, *campaign(1, 4, 5, 8)])
def test_the_nominal_arm_has_nearly_the_given_gravity_and_is_physical(seed):
    arm = generated_arm(seed)
    n, geometry = arm.n_joints, geometry_of(arm)
    q, zero, _ = drawn(n, 50, seed)
    moments = gravity_of(arm).chain.moments / G
    nominal = nominal_parameters(geometry, moments)
    static = regressor(geometry, q, 0 * zero, 0 * zero, G)
    truth = static @ parameters_of(arm)
    # Masses on the links' lines do not reach every moment of links that are bodies anywhere.
    assert ((static @ nominal - truth) ** 2).mean() < 0.35 ** 2 * (truth ** 2).mean()
    masses = mass_matrices(geometry, nominal, q)
    assert np.linalg.eigvalsh(masses).min() > -1e-9 * masses.max()


def mass_matrices(geometry, parameters, q):
    """Return the mass matrices (M, N, N) at poses."""
    n = geometry.n_joints
    unit = np.tile(np.eye(n), (len(q), 1))
    rows = np.repeat(q, n, axis=0)
    return (regressor(geometry, rows, 0 * rows, unit) @ parameters).reshape(-1, n, n)


@pytest.mark.parametrize('seed', [3, *campaign(5)])
def test_half_a_minute_of_motion_identifies_it_with_friction_on_one_joint(seed):
    """A fit of gravity alone yields a tilted base for such motion."""
    arm = arms.iiwa7()
    motion = multisine(arm.lower, arm.upper, np.full(7, 2.0), seed,
                       MultisineOptions(max_speed=1.2), 30.0, 100.0)
    samples = synthesise(arm, motion, SynthesisOptions(
        NoiseOptions(absolute=0.1), seed, disturbances=[Friction(3, LuGre(1.0))]))
    model = fit(samples, FitOptions('chain', geometry=geometry_of(arm))).model
    findings = diagnose(samples, model).findings
    named = {(f.effect, f.joint): f.coefficients for f in findings
             if f.verdict in ('established', 'likely')}
    assert set(named) == {('rigid_body_dynamics', None), ('coulomb_friction', 'iiwa_joint_4')}
    assert abs(named['coulomb_friction', 'iiwa_joint_4']['F_c'].value - 1.0) < 0.02


@pytest.mark.parametrize('noise', [0.0, 0.1])
def test_a_joint_without_gravity_does_not_affect_the_others(noise):
    # Without noise the torque of the first and the last joint of an iiwa is nearly 0.
    arm = arms.iiwa7()
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (500, 7))
    tau = arms.gravity_torque(arm, q)
    measured = tau + max(noise, 1e-6) * np.random.default_rng(2).normal(size=tau.shape)
    samples = JointSamples.single_run(arm.joints, 0.1 * np.arange(500), q, 0 * q, measured)
    chain = fit(samples, FitOptions('chain', geometry=geometry_of(arm))).model.chain
    assert np.abs(chain.torque(q) - tau).max() < 1e-4 + 0.5 * noise


def test_without_axes_it_is_untestable():
    samples = recording(generated_arm(0, 3), 0, 3.0)
    model = fit(samples, FitOptions('potential')).model
    motion = motion_of(model, samples)
    assert 'no serial arm' in known_effect('rigid_body_dynamics').untestable(motion, 0)
    with pytest.raises(DataError, match='cannot be estimated.*no serial arm'):
        refit(samples, model, requests(['rigid_body_dynamics'], samples.names))


def test_a_model_file_includes_the_geometry(tmp_path):
    model = gravity_of(arms.iiwa7())
    save_model(tmp_path / 'm.json', model)
    loaded = load_model(tmp_path / 'm.json').geometry
    assert loaded.joints == model.joints and loaded.source == model.geometry.source
    for name in ('rotations', 'origins', 'link_rotation'):
        assert (getattr(loaded, name) == getattr(model.geometry, name)).all()
    with pytest.raises(DataError, match='geometry'):
        replace(model, geometry=replace(model.geometry, joints=tuple('abcdefg')))
    broken = replace(model.geometry)
    object.__setattr__(broken, 'origins', np.zeros((2, 3)))
    save_model(tmp_path / 'bad.json', replace(model, geometry=broken))
    with pytest.raises(ModelFileError, match='origins'):
        load_model(tmp_path / 'bad.json')


ARM = iiwa7()


@pytest.mark.parametrize('known, seed, limit', [
    (False, 0, 0.06), *campaign((True, 7, 0.05), (True, 0, 0.03), (False, 7, 0.1))])
def test_gravity_does_not_absorb_the_torque_of_motion(known, seed, limit):
    options = FitOptions(geometry=geometry_of(ARM) if known else None)
    samples = moved(ARM, seed, 1.0, 0.3, 0.0, 60.0)
    result = fit(samples, options)
    assert worst(ARM, result.model) < limit
    # The torque of motion is fitted and not predicted.
    assert not result.model.applied.effects and result.report.known_axes == known
    residual = samples.tau - result.model.predict(samples.q)
    np.testing.assert_allclose(list(result.report.rmse.values()),
                               np.sqrt((residual ** 2).mean(axis=0)), rtol=1e-9)


NOISE = FRICTION = 0.3


@pytest.mark.parametrize('seed', [0, *campaign(1)])
def test_gravity_is_accurate_with_friction_fitted_as_an_effect(seed):
    arm, motion = arms.iiwa7(), motions.eq17()
    tau = arms.inverse_dynamics(arm, motion.q, motion.qd, motion.qdd)
    tau += FRICTION * np.tanh(motion.qd / 0.002)
    tau += NOISE * np.random.default_rng([seed, 7]).normal(size=tau.shape)
    samples = JointSamples.single_run(arm.joints, motion.t, motion.q, motion.qd, tau)
    friction = requests(['coulomb_friction'], samples.names)
    model = fit(samples, FitOptions('chain'), effects=friction).model
    values = [next(iter(e.coefficients.values())).value for e in model.applied.effects]
    assert len(values) == 7 and values == pytest.approx([FRICTION] * 7, abs=0.08)
    wide = np.random.default_rng(1).uniform(arm.lower, arm.upper, (500, 7))
    for q, bound in ((motions.eq17(start=100.0).q, 0.15), (wide, 0.6)):
        error = model.predict(q) - arms.gravity_torque(arm, q)
        assert np.sqrt((error ** 2).mean(axis=0)).max() <= bound
        inside = np.abs(error) <= 1.96 * np.hypot(model.predict_std(q), NOISE)
        assert inside.mean() >= 0.95
