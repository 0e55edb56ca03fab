"""External torque: a push is found with its size, friction at rest and bad input are not."""

from dataclasses import replace
import json
import re

from bench.shared.rough_links import JOINTS, two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.evaluation.drift import drift
from gravity_comp_ros.evaluation.expected_residual import friction_size, static_limit
from gravity_comp_ros.evaluation.external_torque import (
    external_torque, ExternalTorqueObserver, mean_weights)
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Value
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.kinematic.arm_columns import described_columns
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import numpy as np
import pytest

NOISE, FRICTION, RATE, COEFFICIENT_STD = 0.1, 2.0, 100.0, 0.05
COULOMB = AppliedEffect('coulomb_friction', 'b', {'width': 0.002},
                        {'F_c': Value(FRICTION, 'N·m', (1.9, 2.1))})
DRIFT = AppliedEffect('torque_drift', 'a', {'origin': 0.0, 'time': 100.0},
                      {'r': Value(1.0, 'N·m/s', (0.9, 1.1)),
                       'b': Value(2.0, 'N·m', (1.9, 2.1))})


def model(*fitted):
    """
    Return tau = (8 sin q_a, 3 sin q_b), trained within 1 rad, and effects as nuisance terms.

    The coefficients 8 and 3 have the standard deviation `COEFFICIENT_STD`.
    """
    energy = Expansion(np.array([2, 6]), np.array([-3.0, -8.0]))  # cos q_b, cos q_a
    gravity = GravityModel.from_energy(
        ('a', 'b'), 'potential', energy, np.full(2, NOISE),
        Coverage(np.full(2, -1.0), np.full(2, 1.0), 100), {},
        covariance=COEFFICIENT_STD ** 2 * np.eye(2))
    return replace(gravity, fitted=Applied(fitted))


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
    assert std == pytest.approx(np.hypot(NOISE, 0.3 * FRICTION), rel=2e-2)
    half = samples.t > 1.5  # where the uncertainty of the gravity of a is known to differ from 0
    scatter = NOISE ** 2 / 4.0  # of four messages
    np.testing.assert_allclose(before.std[half, 0], np.sqrt(
        NOISE ** 2 + scatter + (COEFFICIENT_STD * np.sin(samples.q[half, 0])) ** 2), rtol=0.1)
    assert not before.significant.any() and np.abs(before.torque).max() < 3 * NOISE
    samples = motion(-5.0 * std)
    result = external_torque(MODEL, samples)
    since = samples.t - 1.0
    assert result.torque[since > 0.06, 1] == pytest.approx(-5.0 * std, abs=3 * NOISE)
    assert not result.significant[since < -1e-9].any()
    np.testing.assert_allclose(result.std[since < 0.05 - 1e-9], before.std[since < 0.05 - 1e-9])
    assert result.significant[since > 0.05 - 1e-9, 1].all() and not result.significant[:, 0].any()


def test_more_noise_than_in_training_is_in_the_deviation_and_no_push():
    quiet = motion(duration=10.0, speed=0.05)
    noise = 10.0 * NOISE * np.random.default_rng(3).normal(size=quiet.q.shape)
    result = external_torque(MODEL, replace(quiet, tau=quiet.tau + noise))
    later = quiet.t > 2.0
    assert np.abs(result.torque[later, 0]).max() > 3.5 * NOISE
    assert not result.significant[later].any()
    spread = result.torque[later, 0].std()
    assert np.median(result.std[later, 0]) == pytest.approx(np.hypot(spread, NOISE), rel=0.15)


def test_friction_of_a_joint_at_rest_is_no_push():
    samples = motion(push=-2.0 * FRICTION, speed=0.0)
    result = external_torque(MODEL, samples)
    assert not result.significant.any()
    assert np.nanmin(result.std[:, 1]) > FRICTION > 10 * np.nanmax(result.std[:, 0])
    assert external_torque(MODEL, motion(push=-3.0 * FRICTION, speed=0.0)).significant[:, 1].any()


INERTIA = 2.0


def vertical_axis(*fitted):
    """Return the model of a vertical axis of `INERTIA` kg·m^2, and effects as nuisance terms."""
    text = ('<robot name="r"><link name="l0"/><link name="l1"/><joint name="j" type="revolute">'
            '<parent link="l0"/><child link="l1"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="9" velocity="2"/></joint></robot>')
    geometry = described_arm(text, ('j',)).geometry
    column = described_columns(geometry, *np.zeros((2, 1, 1)), np.ones((1, 1)))[0, 0]
    inertia = AppliedEffect('rigid_body_dynamics', None, {}, {
        f'p_{k + 1}': Value(INERTIA * x / (column @ column), '', (0.0, 9.0))
        for k, x in enumerate(column)})
    energy = Expansion(np.array([1]), np.array([0.0]))
    gravity = GravityModel.from_energy(
        ('j',), 'potential', energy, np.full(1, NOISE), Coverage(-np.ones(1), np.ones(1), 9), {},
        covariance=np.zeros((1, 1)))
    return replace(gravity, geometry=geometry, fitted=Applied((inertia, *fitted)))


def rotated(axis, speed, qdd, tau):
    """Return times in s and the results of an axis at 100 Hz, with accelerations from 0.5 s on."""
    t = np.arange(0.0, 0.6, 0.01)
    qd = speed + np.cumsum(qdd(t))[:, None] * 0.01
    noisy = tau(t) + 0.02 * np.random.default_rng(0).normal(size=len(t))
    return t, external_torque(axis, JointSamples.single_run(
        ('j',), t, np.cumsum(qd, axis=0) * 0.01, qd, noisy[:, None]))


def test_the_static_limit_is_the_friction_of_low_speed():
    """The Stribeck friction falls before its direction is built up, and hardly acts."""
    narrow = AppliedEffect('coulomb_friction', 'a', {'width': 0.002},
                           {'F_c': Value(1.0, 'N·m', (0.9, 1.1))})
    wide = AppliedEffect('coulomb_friction', 'b', {'width': 0.03},
                         {'F_c': Value(FRICTION, 'N·m', (1.9, 2.1))})
    stribeck = AppliedEffect('stribeck_friction', 'a', {'width': 0.06, 'speed': 0.005},
                             {'F_s': Value(2.0, 'N·m', (1.9, 2.1))})
    viscous = AppliedEffect('viscous_friction', 'b', {}, {'F_v': Value(5.0, '', (4.9, 5.1))})
    limit = static_limit(MODEL, [narrow, wide, stribeck, viscous], np.array([0.01, 0.03]))
    assert 1.0 < limit[0] < 1.15
    assert limit[1] == pytest.approx(FRICTION * np.tanh(2.0) + 5.0 * 0.06)


def accelerated(share):
    """Return results of 0.5 s at rest and 0.1 s of acceleration, with its torque as a share."""
    return rotated(vertical_axis(), 0.0, lambda t: 5.0 * (t > 0.5),
                   lambda t: INERTIA * share * 5.0 * (t > 0.5))


def test_acceleration_is_a_push_where_the_drive_has_no_torque_for_it():
    for share in (1.0, 0.6, 1.6):  # a wrong inertia
        assert not accelerated(share)[1].significant.any()
    for share in (0.0, -0.2):
        t, result = accelerated(share)
        assert result.significant[t > 0.545].all() and not result.significant[t < 0.5].any()


@pytest.mark.parametrize('is_pushed', [False, True])
def test_a_joint_that_a_push_stops_is_found_and_one_that_its_drive_stops_is_not(is_pushed):
    """Friction of 1 N·m does not stop it: at rest it may have any direction, but is no larger."""
    friction = AppliedEffect('coulomb_friction', 'j', {'width': 0.002},
                             {'F_c': Value(1.0, 'N·m', (0.9, 1.1))})
    viscous = AppliedEffect('viscous_friction', 'j', {}, {'F_v': Value(6.0, '', (5.0, 7.0))})

    def stops(t):
        return -1.0 * ((t > 0.505) & (t < 0.525))

    t, result = rotated(vertical_axis(friction, viscous), 0.02, stops,
                        lambda t: 1.12 + INERTIA * stops(t) * (not is_pushed))
    moving = (t > 0.1) & (t < 0.5)
    assert 5.0 * result.std[moving].max() < INERTIA
    assert result.significant[t < 0.56].any() == is_pushed
    assert not result.significant[moving].any()


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

    assert [add(k, 0.01 * k) is None for k in range(6)] == [True] * 3 + [False] * 3
    assert add(6, 0.3) is None
    assert [add(k, 0.3 + 0.01 * k) is None for k in range(1, 5)] == [True] * 2 + [False] * 2
    assert add(5, 0.1) is None and add(6, 0.11) is None
    # At 1 kHz a result comes 200 times a second.
    observer = ExternalTorqueObserver(MODEL)
    zero = np.zeros(2)
    results = [observer.add(0.001 * k, zero, zero, zero) for k in range(1000)]
    assert 185 <= sum(result is not None for result in results) <= 200


def test_effects_that_need_earlier_samples_are_named():
    assert ExternalTorqueObserver(model(COULOMB, DRIFT)).left_out == ('torque_drift:a',)
    assert ExternalTorqueObserver(MODEL).left_out == ()


def test_warming_and_drift_after_an_hour_are_no_push():
    """The sizes are those of a warm arm: 3 N·m on b and 2 N·m on a."""
    warming = AppliedEffect('friction_drift', 'b', {'origin': 0.0, 'time': 600.0, 'width': 0.002},
                            {'F_w': Value(3.0, 'N·m', (2.9, 3.1)),
                             'B_w': Value(0.0, 'N·m·s/rad', (0.0, 0.0))})
    drift = AppliedEffect('torque_drift', 'a', DRIFT.setting, {
        'r': Value(0.0, 'N·m/s', (0.0, 0.0)), 'b': Value(2.0, 'N·m', (1.9, 2.1))})
    fitted = model(COULOMB, warming, drift)
    samples = motion()
    samples = replace(samples, tau=samples.tau + [2.0, -3.0])
    result = external_torque(fitted, samples)
    assert np.nanmin(result.std, axis=0) == pytest.approx([2.0, 3.0], rel=0.1)
    assert not result.significant.any() and external_torque(MODEL, samples).significant.any()
    np.testing.assert_allclose(friction_size(fitted)[1], FRICTION, rtol=0.03)
    np.testing.assert_allclose(friction_size(model(warming))[1], 3.0, rtol=0.02)


def test_of_a_model_without_uncertainty_the_deviation_is_unknown_and_nothing_is_significant():
    samples = motion(push=-50.0)
    unsure = replace(MODEL, formulation='per_joint', energy=None, covariance=None)
    result = external_torque(unsure, samples)
    assert np.isnan(result.std).all() and not result.significant.any()
    known = external_torque(MODEL, samples)
    assert known.significant[:, 1].any()
    np.testing.assert_array_equal(result.torque, known.torque)


def test_an_effect_of_another_version_is_left_out_and_its_joint_is_uncertain():
    other = AppliedEffect('coulomb_friction', 'a', {'width': 0.002},
                          {'F_x': Value(1.0, 'N·m', (0.9, 1.1))})
    missing = AppliedEffect('not_installed', 'a', {}, {'x': Value(1.0, '', (0.9, 1.1))})
    samples = motion(-5.0)
    result, known = (external_torque(one, samples)
                     for one in (model(COULOMB, other, missing), MODEL))
    np.testing.assert_array_equal(result.torque, known.torque)
    assert np.isnan(result.std[:, 0]).all()
    np.testing.assert_array_equal(result.std[:, 1], known.std[:, 1])
    whole_arm = AppliedEffect('not_installed', None, {}, {'x': Value(1.0, '', (0.9, 1.1))})
    assert np.isnan(external_torque(model(COULOMB, whole_arm), samples).std).all()


def test_samples_of_another_arm_are_refused():
    with pytest.raises(ModelMismatchError):
        external_torque(MODEL, JointSamples.single_run(
            ('x', 'y'), np.arange(2.0), *np.zeros((3, 2, 2))))


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """
    Return a folder with a.json and b.json of the same arm, and c.json of a changed one.

    The changed arm has 2.5 times the friction, and a mass that is 2 N·m at the elbow.
    """
    folder = tmp_path_factory.mktemp('drift')
    for name, seed in (('a', 1), ('b', 2), ('c', 3)):
        samples = two_links(seed, rough=2.5 if name == 'c' else 1.0)
        if name == 'c':
            both = 2.0 * np.sin(samples.q.sum(axis=1))
            samples = replace(samples, tau=samples.tau + both[:, None])
        write_bag(folder / f'{name}.mcap', [joint_states(samples)])
        assert main(['fit', str(folder / f'{name}.mcap'), '-o', str(folder / f'{name}.json')]) == 0
    return folder


def test_the_same_arm_has_not_drifted_and_a_changed_one_has(folder):
    a, b, c = (load_model(folder / f'{name}.json') for name in 'abc')
    poses = two_links(4)
    same, changed = drift(a, b, poses), drift(a, c, poses)
    assert not any(one.drifted for one in (*same.joints.values(), *same.coefficients))
    torque = 2.0 * np.sin(poses.q.sum(axis=1))
    for name in JOINTS:
        assert changed.joints[name].drifted
        assert changed.joints[name].rms == pytest.approx(np.sqrt((torque ** 2).mean()), rel=0.4)
    viscous, = (one for one in changed.coefficients if one.symbol == 'F_v'
                and one.target == 'viscous_friction:shoulder')
    assert viscous.drifted
    assert viscous.before.value == pytest.approx(5.0, rel=0.2)
    assert viscous.after.value == pytest.approx(12.5, rel=0.2)


def test_coefficients_with_other_nonlinear_parameters_are_not_compared():
    """The constant of a spring depends on its centre; Coulomb friction not on its width."""
    def spring(centre, m):
        return AppliedEffect('joint_spring', 'a', {'centre': centre, 'overtones': 0.0}, {
            'k': Value(4.0, 'N·m/rad', (3.9, 4.1)), 'm': Value(m, 'N·m', (m - 0.1, m + 0.1))})
    before, narrow = model(COULOMB, spring(0.0, 1.0)), replace(COULOMB, setting={'width': 0.001})
    other = drift(before, model(narrow, spring(0.5, 3.0)), motion())
    assert [(one.symbol, one.drifted) for one in other.coefficients] == [('F_c', False)]
    same = drift(before, model(spring(0.0, 3.0)), motion())
    assert [(one.symbol, one.drifted) for one in same.coefficients] == [
        ('k', False), ('m', True), ('F_c', True)]


def test_an_update_has_drifted_though_gravity_is_not_separated_from_a_spring():
    """The split of both has no effect on their sum, with which the torque changed."""
    split = AppliedEffect('joint_spring', 'b', {'centre': 0.0, 'overtones': 0.0}, {
        'k': Value(4.0, 'N·m/rad', (-5.0, 13.0)), 'm': Value(0.0, 'N·m', (-2.0, 2.0))})
    # Columns of b are -sin q_b and q_b, whose sum is nearly 0.
    joint = np.diag([1e-3, 0.0025, 1e-3, 1e-3])
    joint[np.ix_([0, 2], [0, 2])] += 9.0 * np.ones((2, 2))
    before = replace(model(), applied=Applied((split,)), covariance=joint, static=(split.target,))
    energy = Expansion(before.energy.indices, before.energy.weights - [5.0, 0.0])
    after, poses = replace(before, energy=energy, torques=()), motion(duration=5.0)
    changed = replace(after, applied=Applied(), static=(), covariance=joint[:2, :2])
    of_b = drift(before, after, poses).joints['b']
    assert of_b.drifted and not of_b.unknown
    assert of_b.rms == pytest.approx(5.0 * np.sqrt((np.sin(poses.q[:, 1]) ** 2).mean()))
    # Gravity alone, with the torque of the sum before.
    of_b = drift(before, changed, poses).joints['b']
    assert not of_b.drifted and not of_b.unknown
    same = drift(before, before, poses).joints['b']
    assert not same.drifted and not same.unknown


def test_compare_lists_the_updates_since_the_earlier_model(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(['update', 'c.mcap', '--model', 'a.json', '-o', 'updated.json']) == 0
    capsys.readouterr()
    assert main(['compare', 'c.mcap', '--model', 'updated.json', '--previous', 'a.json']) == 0
    out = capsys.readouterr().out
    assert re.search(r'update of .*: the torque of the payload is up to 1[.0-9]* N·m of', out)
    assert main(['compare', 'c.mcap', '--model', 'updated.json', '--previous', 'b.json']) == 0
    assert 'update of' not in capsys.readouterr().out


def test_other_joints_are_refused(folder):
    a = load_model(folder / 'a.json')
    other = replace(a, joints=('x', 'y'), geometry=None, applied=type(a.applied)(),
                    fitted=type(a.fitted)(), static=(), covariance=None)
    with pytest.raises(ModelMismatchError, match='different joints'):
        drift(other, a, two_links(4))


def test_compare_shows_the_drift_in_the_terminal_and_as_json(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    command = ['compare', 'b.mcap', '--model', 'c.json', '--previous', 'a.json']
    assert main(command) == 0
    out = capsys.readouterr().out
    assert 'change of the gravity torque since a.json' in out
    assert 'viscous_friction:shoulder F_v: 5' in out and '→ 12' in out
    assert main([*command, '--json']) == 0
    previous = json.loads(capsys.readouterr().out)['previous']
    assert previous['model'] == 'a.json' and previous['joints']['elbow']['drifted']
    assert any(one['drifted'] and one['symbol'] == 'F_v' for one in previous['coefficients'])
    assert main(['compare', 'a.mcap', '--model', 'b.json', '--previous', 'a.json']) == 0
    assert 'no coefficient of an effect drifted' in capsys.readouterr().out
    assert main([*command[:-1], 'missing.json']) == 1
    assert 'missing.json' in capsys.readouterr().err
