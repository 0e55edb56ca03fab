"""Fits of arms with known torque: by hand, of any length, tilted, with joints at rest."""

from dataclasses import replace
from functools import partial
import json

from bench.cases.signals import ornstein_uhlenbeck
from bench.shared.regression_cases import two_links
from bench.shared.serial_arms import G, planar_2r, poses, samples_of, serial_arm
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.sparse import admm, dictionary, sparse_fit
from gravity_comp_ros.models.sparse.lasso import LassoProblem
from gravity_comp_ros.simulation.arms import gravity_torque, with_base_tilt
import numpy as np
import pytest

BOTH = pytest.mark.parametrize('formulation', ['potential', 'per_joint'])


def rms(x: np.ndarray) -> np.ndarray:
    return np.sqrt((x ** 2).mean(axis=0))


def uses(model, joint: int, of: int) -> bool:
    """Return whether the torque of joint `of` has a feature with sin or cos of `joint`."""
    features = model.torques[of].indices
    return bool(dictionary.digits(features, model.n_joints)[:, joint].any())


@BOTH
def test_a_pendulum(formulation):
    # m = 2 kg, l = 0.5 m, hanging at q = 0: tau = m g l sin q, U = -m g l cos q.
    q = poses(60, 1)
    result = fit(samples_of(q, 2 * G * 0.5 * np.sin(q), 0.01), FitOptions(formulation))
    model = result.model
    assert model.equation('axis0') == f'{model.torques[0].weights[0]:.2f} s1'
    assert model.torques[0].weights[0] == pytest.approx(9.81, abs=0.01)
    assert result.converged and result.report.features == {'axis0': 1}
    if formulation == 'potential':
        np.testing.assert_array_equal(model.energy.indices, [2])
        assert model.energy.weights[0] == pytest.approx(-9.81, abs=0.01)


@BOTH
def test_two_links_in_a_plane(formulation):
    # m1 = 3, m2 = 2 kg, l1 = 0.5, c1 = 0.25, c2 = 0.2 m, and cos(q1 + q2) = c1 c2 - s1 s2.
    q = poses(120, 2, seed=3)
    model = fit(samples_of(q, planar_2r(q), 0.05), FitOptions(formulation)).model
    upper, lower = (3 * 0.25 + 2 * 0.5) * G, 2 * 0.2 * G
    first = dict(zip(model.torques[0].indices.tolist(), model.torques[0].weights))
    second = dict(zip(model.torques[1].indices.tolist(), model.torques[1].weights))
    c1, c1c2, s1s2 = 6, 8, 4
    assert first == pytest.approx({c1: upper, c1c2: lower, s1s2: -lower}, abs=0.026)
    assert second == pytest.approx({c1c2: lower, s1s2: -lower}, abs=0.026)


@pytest.mark.parametrize('formulation, n_joints', [
    ('potential', 1), ('potential', 8), ('per_joint', 1), ('per_joint', 7)])
def test_arms_of_any_length(formulation, n_joints):
    arm = with_base_tilt(serial_arm(n_joints, seed=1), 0.0, 0.4 if n_joints == 1 else 0.0)
    count = 300 if formulation == 'potential' else 600
    q = poses(count, n_joints)
    tau = gravity_torque(arm, q)
    result = fit(samples_of(q, tau, 0.1), FitOptions(formulation))
    unseen = poses(200, n_joints, seed=1)
    error = rms(result.model.predict(unseen) - gravity_torque(arm, unseen))
    assert result.converged
    assert (error < 0.1).all()
    assert (result.model.noise < 0.12).all()
    if n_joints > 1:
        assert not result.model.predict(unseen)[:, 0].any()   # a vertical axis


@BOTH
def test_a_tilted_base_requires_features_of_the_first_joint(formulation):
    q = poses(300, 4)
    uses_first = {}
    for tilt in (0.0, 0.1):
        arm = with_base_tilt(serial_arm(4), tilt, 0.0)
        model = fit(samples_of(q, gravity_torque(arm, q), 0.05), FitOptions(formulation)).model
        uses_first[tilt] = [uses(model, 0, of) for of in range(4)]
        unseen = poses(200, 4, seed=1)
        assert rms(model.predict(unseen) - gravity_torque(arm, unseen)).max() < 0.05
    assert uses_first[0.0] == [False] * 4
    assert uses_first[0.1][:2] == [True, True]


@BOTH
@pytest.mark.parametrize('still, jitter', [(1, 0.0), (2, 2e-4)])
def test_a_joint_at_rest(formulation, still, jitter):
    arm, rng = serial_arm(4), np.random.default_rng(0)
    q = poses(250, 4)
    q[:, still] = 0.7 + jitter * rng.uniform(-1, 1, 250)
    tau = gravity_torque(arm, q)
    result = fit(samples_of(q, tau, 0.05), FitOptions(formulation))
    name = f'axis{still}'
    assert result.report.dropped_joints == (name,)
    assert any(name in message and 'never moved' in message for message in result.report.warnings)
    unseen = poses(200, 4, seed=1)
    unseen[:, still] = 0.7
    truth = gravity_torque(arm, unseen)
    assert np.abs(truth[:, still]).max() > 1.0    # its own torque is not 0
    assert rms(result.model.predict(unseen) - truth).max() < 0.05
    if formulation == 'per_joint':
        assert not any(uses(result.model, still, of) for of in range(4))
    assert result.model.extrapolation(unseen[0] + 0.1 * np.eye(4)[still]) > 0.09


REST = 0.5 * np.ones((50, 2))


@pytest.mark.parametrize('q, tau, noise, message', [
    (poses(20, 13), np.sin(poses(20, 13)), 0.0, '13 joints; the dictionary takes 1 to 12'),
    (poses(9, 2), planar_2r(poses(9, 2)), 0.0, '9 slow samples; a fit needs at least 10'),
    (REST, planar_2r(REST), 0.1, 'no joint moves'),
    (REST + 5e-4 * poses(50, 2, reach=1.0), planar_2r(REST), 0.1, 'no joint moves'),
    (poses(50, 2), np.zeros((50, 2)), 0.0, 'effort is 0 for every joint')])
def test_samples_that_cannot_be_fitted_are_refused(q, tau, noise, message):
    with pytest.raises((FitError, ValueError), match=message) as caught:
        fit(samples_of(q, tau, noise), FitOptions('potential'))
    assert '\n' not in str(caught.value)


@BOTH
def test_noise_alone_gives_a_model_of_zero_and_a_warning(formulation):
    q = poses(100, 3)
    result = fit(samples_of(q, np.zeros_like(q), 1.0), FitOptions(formulation))
    assert not result.model.predict(q).any()
    assert result.model.equation('axis1') == '0'
    assert any('the model is 0 everywhere' in message for message in result.report.warnings)


def test_reordered_joints_give_the_same_model_reordered():
    arm, q, order = serial_arm(4), poses(200, 4), [1, 3, 0, 2]
    samples = samples_of(q, gravity_torque(arm, q), 0.1)
    names = [samples.names[k] for k in order]
    original, reordered = (fit(each, FitOptions('potential')).model
                           for each in (samples, samples.joints(names)))
    assert reordered.joints == tuple(names)
    np.testing.assert_array_equal(reordered.n_features(), original.n_features()[order])
    unseen = poses(50, 4, seed=1)
    np.testing.assert_allclose(reordered.predict(unseen[:, order]),
                               original.predict(unseen)[:, order], atol=1e-6)


def test_an_offset_is_fitted_and_not_predicted():
    # A constant torque on joint 1 is not the gradient of a periodic energy, and over full
    # revolutions it is not collinear with one.
    q = poses(300, 2, reach=np.pi)
    tau = planar_2r(q) + [1.5, 0.0]
    samples = samples_of(q, tau, 0.05)
    for formulation in ('auto', 'chain', 'potential'):
        model = fit(samples, FitOptions(formulation)).model
        residual = samples.tau - model.predict(q)
        assert residual.mean(axis=0) == pytest.approx([1.5, 0.0], abs=0.1)
        # It is reported with its size, and not predicted.
        effect, = model.fitted.effects
        assert effect.target == 'torque_offset:axis0'
        low, high = effect.coefficients['b'].ci95
        assert effect.coefficients['b'].value == pytest.approx(1.5, abs=high - low)
    # In `per_joint` the dictionary includes the constant.
    other = fit(samples, FitOptions('per_joint')).model
    assert uses(other, 0, 0) and 0 in other.torques[0].indices
    assert rms(samples.tau - other.predict(q)).max() < 0.1


def test_a_requested_formulation_has_the_effects_of_the_chain():
    samples = two_links(0, lambda q, qd, t: np.tanh(qd / 0.02) * [2.0, 0.0])
    samples = samples.select(np.arange(0, len(samples), 4))
    chain, *others = (
        {effect.target for effect in fit(samples, FitOptions(name)).model.fitted.effects}
        for name in ('chain', 'potential', 'per_joint'))
    assert others == 2 * [chain - {'rigid_body_dynamics'}]
    assert 'coulomb_friction:j0' in chain


def test_the_report_is_json_and_the_certificate_within_tolerance():
    q = poses(120, 2)
    samples = samples_of(q, planar_2r(q), 0.05)
    steps = []
    result = fit(samples, FitOptions('potential'), lambda message, share: steps.append(share))
    report = json.loads(json.dumps(result.report.to_json(), allow_nan=False))
    solver = report['solver'][0]
    assert solver['converged'] and -1e-9 <= solver['gap'] < 1e-5
    assert solver['violation'] < 1e-6 and solver['iterations'] > 0
    assert 0 <= solver['primal_residual'] < 1e-5 * solver['lambda']
    assert 0 <= solver['dual_residual'] < 1e-5 * solver['lambda']
    residual = rms(samples.tau - result.model.predict(q))
    assert list(report['rmse'].values()) == pytest.approx(residual.tolist())
    assert result.model.noise == pytest.approx(residual)
    assert report['noise']['axis0'] == pytest.approx(0.05, rel=0.3)
    assert steps[0] == 0.0 and steps[-1] == 1.0 and steps == sorted(steps)
    assert result.model.provenance['report']['features'] == result.report.features


def test_failure_to_converge_is_reported(monkeypatch):
    monkeypatch.setattr(admm, 'polish', lambda gram, c, penalties, z, tolerance: 0 * z)
    q = poses(100, 3, reach=0.3)
    tau = gravity_torque(serial_arm(3), q)
    monkeypatch.setattr(sparse_fit, 'LassoProblem', partial(
        LassoProblem, options=admm.AdmmOptions(max_iterations=1)))
    result = fit(samples_of(q, tau, 0.05), FitOptions('potential'))
    assert not result.converged
    assert any('did not reach its tolerance' in message for message in result.report.warnings)
    assert not result.report.solver[0].lasso.converged
    assert result.report.solver[0].lasso.certificate.violation > 1e-4


def test_autocorrelated_noise_inflates_the_variance_and_keeps_the_model_small(monkeypatch):
    t = 0.2 * np.arange(300)
    arm = serial_arm(2)
    q = np.column_stack([0.8 * np.sin(0.13 * t), 0.7 * np.sin(0.19 * t + 1)])
    noise = ornstein_uhlenbeck(np.random.default_rng(0).standard_normal(q.shape), 0.2, 2.0)
    tau = gravity_torque(arm, q) + 0.5 * noise
    samples = samples_of(q, tau)
    inflated = fit(samples, FitOptions('potential'))
    monkeypatch.setattr(sparse_fit, '_FACTORS', (1.0,))
    naive = fit(samples, FitOptions('potential'))
    assert inflated.report.solver[0].inflation > 1.0
    assert inflated.model.n_features().sum() < naive.model.n_features().sum()


ARM = serial_arm(4, 3)
NOISE = 0.1
ELBOW = 2


def recorded(offset: float, seed: int) -> JointSamples:
    """Return 400 poses with white noise, and an offset in N·m on the third joint."""
    q = poses(400, 4, seed)
    tau = gravity_torque(ARM, q) + NOISE * np.random.default_rng(seed).normal(size=q.shape)
    tau[:, ELBOW] += offset
    return JointSamples.single_run(ARM.joints, 0.2 * np.arange(len(q)), q, np.zeros_like(q), tau)


@pytest.fixture(scope='module')
def old():
    """Return a model whose chain was fitted without offsets."""
    model = fit(recorded(0.0, 1), FitOptions('chain')).model
    assert not model.fitted.effects and not model.applied.effects
    return model


def test_a_fit_that_starts_from_a_chain_without_offsets_finds_one(old):
    model = fit(recorded(0.5, 2), FitOptions('chain'), old=old).model
    effect, = (*model.fitted.effects, *model.applied.effects)
    assert effect.target == f'torque_offset:{ARM.joints[ELBOW]}'
    assert effect.coefficients['b'].value == pytest.approx(0.5, abs=0.03)
    assert model.residual_std == pytest.approx(np.full(4, NOISE), rel=0.1)


def data(seed: int, arm_seed: int = 0):
    q = poses(150, 4, seed=seed)
    return samples_of(q, gravity_torque(serial_arm(4, seed=arm_seed), q), 0.1)


def test_the_result_does_not_depend_on_the_start():
    # The old model is of a different arm, or of other joints.
    old = fit(data(5, 1), FitOptions('potential')).model
    cold, *others = (fit(data(0), FitOptions('potential'), old=start).model
                     for start in (None, old, replace(old, joints=('a', 'b', 'c', 'd'))))
    for warm in others:
        for one, other in zip(cold.torques, warm.torques):
            np.testing.assert_array_equal(one.indices, other.indices)
            np.testing.assert_allclose(one.weights, other.weights, atol=1e-3)
