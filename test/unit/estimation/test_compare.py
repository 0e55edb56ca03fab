"""Comparison: figures calculated by hand, JSON schema, regions of large residual."""


from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.evaluation.compare import (
    compare, compare_prediction, Comparison)
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np
import pytest

ARM = arms.iiwa7()


def samples_of(tau, q=None, qd=None, names=('a',), label='run') -> JointSamples:
    tau = np.asarray(tau, dtype=float).reshape(-1, len(names))
    zeros = np.zeros_like(tau)
    return JointSamples.single_run(names, 0.1 * np.arange(len(tau)),
                                   zeros if q is None else q, zeros if qd is None else qd, tau,
                                   label)


def against(samples: JointSamples, predicted, outside=None) -> Comparison:
    outside = np.zeros(len(samples), dtype=bool) if outside is None else outside
    return compare_prediction(samples, np.asarray(predicted, dtype=float), outside)


def sine_model(*weights: float) -> GravityModel:
    """Return joints j0, j1, ... with torque weight * sin q each."""
    n = len(weights)
    torques = tuple(Expansion(np.array([3 ** (n - 1 - k)]), np.array([w]))
                    for k, w in enumerate(weights))
    return GravityModel(tuple(f'j{k}' for k in range(n)), 'per_joint', torques, None,
                        np.zeros(n), Coverage(-np.ones(n), np.ones(n), 10))


def test_figures_by_hand():
    # Residuals 1, -1, 3, 1: mean 1, mean square 3, variance 2; the torque ranges over 10.
    comparison = against(samples_of([0.0, 4.0, 10.0, 6.0]), [[-1.0], [5.0], [7.0], [5.0]])
    joint = comparison.joints['a']
    assert (joint.n, joint.max_abs, joint.bias) == (4, 3.0, 1.0)
    assert joint.rmse == pytest.approx(np.sqrt(3))
    assert joint.std == pytest.approx(np.sqrt(2))
    assert joint.nrmse == pytest.approx(np.sqrt(3) / 10)
    assert joint.torque_std == pytest.approx(np.sqrt(13))   # of 0, 4, 10, 6 around 5
    np.testing.assert_allclose(comparison.residual[:, 0], [1.0, -1.0, 3.0, 1.0])
    # A constant torque has no nRMSE.
    comparison = against(samples_of([2.0, 2.0, 2.0]), [[1.0], [2.0], [3.0]])
    assert comparison.joints['a'].nrmse is None
    assert comparison.joints['a'].rmse == pytest.approx(np.sqrt(2 / 3))
    samples = samples_of(np.arange(40.0))
    joint = against(samples, samples.tau).joints['a']
    assert (joint.rmse, joint.nrmse, joint.max_abs, joint.where) == (0.0, 0.0, 0.0, ())


def test_joints_are_matched_by_name():
    q = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    samples = samples_of(np.sin(q) * [5.0, 2.0], q=q, names=('j0', 'j1'))
    model = sine_model(5.0, 2.0)
    for one in (samples, samples.joints(['j1', 'j0'])):
        comparison = compare(model, one)
        assert list(comparison.joints) == ['j0', 'j1']
        assert max(joint.rmse for joint in comparison.joints.values()) < 1e-12


def test_a_missing_joint_and_no_samples():
    with pytest.raises(ModelMismatchError, match='no joint j1'):
        compare(sine_model(1.0, 1.0), samples_of(np.zeros(5), names=('j0',)))
    with pytest.raises(DataError, match='no samples to compare with'):
        compare(sine_model(1.0), samples_of(np.zeros(0), names=('j0',)))


def test_poses_outside_the_trained_range_are_counted():
    q = np.array([[0.0], [0.5], [1.5], [-2.0]])
    samples = samples_of(np.sin(q), q=q, names=('j0',))
    assert compare(sine_model(1.0), samples).share_outside == 0.5


@pytest.mark.parametrize('axis, condition', [
    ('position', lambda q, qd: (q > 0.0) & (q < 0.7)), ('direction', lambda q, qd: qd > 1e-3)])
def test_an_error_in_one_condition_is_reported_first(axis, condition):
    motion = motions.multisine(ARM.lower, ARM.upper, ARM.max_speed, 0)
    samples = synthesise(ARM, motion, SynthesisOptions(NoiseOptions(absolute=0.1)))
    predicted = arms.inverse_dynamics(ARM, motion.q, motion.qd, motion.qdd)
    predicted[:, 2] -= 0.7 * condition(motion.q[:, 2], motion.qd[:, 2])
    region = against(samples, predicted).joints['iiwa_joint_3'].where[0]
    assert region.axis == axis and region.bias == pytest.approx(0.7, abs=0.05)
    assert axis != 'position' or -0.1 < region.low < region.high < 0.8


def test_an_error_in_one_run_is_reported_first():
    # The same motion every time, so that no other condition distinguishes the bad run.
    motion, parts, predictions = motions.eq17(), [], []
    for run in range(3):
        part = synthesise(ARM, motion, SynthesisOptions(static=True, seed=run,
                                                        noise=NoiseOptions(absolute=0.1)))
        parts.append(JointSamples.single_run(part.names, part.t, part.q, part.qd,
                                             part.tau + 0.6 * (run == 1), f'tour{run}'))
        predictions.append(arms.gravity_torque(ARM, motion.q))
    comparison = against(concatenate(parts), np.concatenate(predictions))
    for joint in comparison.joints.values():
        assert joint.where[0].axis == 'run'
        assert joint.where[0].words.startswith('in run tour1:')


def test_an_error_outside_the_trained_range_is_reported():
    rng = np.random.default_rng(1)
    q = rng.uniform(-1.6, 1.6, (400, 2))
    outside = np.abs(q).max(axis=1) > 1.0
    tau = 0.1 * rng.normal(size=q.shape) + outside[:, None] * rng.normal(size=q.shape)
    comparison = compare(sine_model(0.0, 0.0), samples_of(tau, q=q, names=('j0', 'j1')))
    for joint in comparison.joints.values():
        assert 'trained range' in [region.axis for region in joint.where]


def test_an_error_in_a_single_visit_is_no_region():
    # The error is large on one of five visits to the right end, and on none of the others.
    t = np.arange(500) * 0.1
    q = np.sin(2 * np.pi * t / 10)[:, None]
    rng = np.random.default_rng(0)
    tau = 0.1 * rng.normal(size=(500, 1))
    tau[(q[:, 0] > 0.7) & (t > 20) & (t < 30)] += 0.5
    joint = against(samples_of(tau, q=q), np.zeros((500, 1))).joints['a']
    assert 'position' not in [region.axis for region in joint.where]


@pytest.mark.parametrize('kind', ['poses', 'motion'])
def test_white_noise_has_no_regions(kind):
    named = total = 0
    for seed in range(5):
        motion = motions.eq17() if kind == 'motion' else motions.random_poses(
            ARM.lower, ARM.upper, 200, seed)
        samples = synthesise(ARM, motion, SynthesisOptions(
            static=True, seed=seed, noise=NoiseOptions(absolute=0.1)))
        comparison = against(samples, arms.gravity_torque(ARM, motion.q))
        named += sum(bool(joint.where) for joint in comparison.joints.values())
        total += len(comparison.joints)
    assert named <= 0.02 * total


def test_band_counts_by_hand():
    samples = samples_of([0.0, 0.1, -0.1, 0.3, -0.3, 0.2])
    outside = np.array([False, False, False, False, True, True])
    band, zero = np.full((6, 1), 0.25), np.zeros((6, 1))
    comparison = compare_prediction(samples, zero, outside, band)
    for each in (comparison, comparison.joints['a']):
        assert (each.in_band, each.in_band_outside) == (0.75, 0.5)
    assert comparison.to_json()['in_band_outside'] == 0.5
    inside = compare_prediction(samples, zero, np.zeros(6, dtype=bool), band)
    assert inside.in_band == pytest.approx(4 / 6) and inside.in_band_outside is None
    assert compare_prediction(samples, zero, outside).in_band is None
    # A model without uncertainty has no band.
    comparison = compare(sine_model(1.0), samples_of([0.0, 1.0, 2.0], names=('j0',)))
    assert comparison.in_band is None
    assert comparison.to_json()['joints']['j0']['in_band_outside'] is None


def test_the_band_of_a_model_covers_95_percent(iiwa_model_file):
    model = load_model(iiwa_model_file)
    noise = SynthesisOptions(NoiseOptions(absolute=0.1), seed=1, static=True)
    samples = concatenate([synthesise(ARM, motion, noise) for motion in (
        motions.eq17(start=100.0), motions.random_poses(ARM.lower, ARM.upper, 300))])
    comparison = compare(model, samples)
    assert 0.92 <= comparison.in_band <= 0.98
    assert comparison.in_band_outside >= 0.9
    spread = np.hypot(model.predict_std(samples.q), model.noise)
    inside = np.abs(samples.tau - model.predict(samples.q)) <= 1.96 * spread
    outside = comparison.share_outside
    assert inside.mean() == pytest.approx(
        (1.0 - outside) * comparison.in_band + outside * comparison.in_band_outside)
