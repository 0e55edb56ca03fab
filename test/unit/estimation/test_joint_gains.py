"""Gains and a base that contradict one arm: found with their sizes, and not found falsely."""

from dataclasses import replace
from pathlib import Path
import re

from bench.cases.arms import six_axis
from bench.shared.campaign import campaign
from bench.shared.rough_links import two_links
from bench.shared.serial_arms import serial_arm
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.estimation.arm_fit import ArmFit, moves_enough
from gravity_comp_ros.estimation.fit import fit, FitOptions
from gravity_comp_ros.estimation.joint_gains import common_gain, joint_gains
from gravity_comp_ros.estimation.moved_base import moved_base
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.estimation.torque_facts import torque_facts
from gravity_comp_ros.facts.fact import Action, Kind
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation.arms import gravity_torque, Payload, with_base_tilt, with_payload
import numpy as np
import pytest

ARM = six_axis()
HEAVY = with_payload(ARM, Payload(4.0, (0.05, 0.0, 0.1)))
PERIODS = np.array([61.0, 43.0, 29.0, 37.0, 53.0, 47.0, 31.0])
FRICTION = np.array([2.0, 3.0, 2.0, 1.0, 0.8, 0.5, 0.5])


def recorded(gains=1.0, more=None, arm=ARM, seed=0, noise=0.05):
    """Return 120 s at 2.5 Hz with friction and noise; `more` adds a torque of (q, qd, t)."""
    n, t = arm.n_joints, np.arange(300) / 2.5
    rng = np.random.default_rng(seed)
    w, phase = 2 * np.pi / PERIODS[:n], rng.uniform(0, 2 * np.pi, n)
    centre = np.array([0.2, -0.9, 0.8, -0.5, 0.7, 0.1, 0.3])[:n]
    q = centre + 0.6 * np.sin(w * t[:, None] + phase)
    qd = 0.6 * w * np.cos(w * t[:, None] + phase)
    tau = gravity_torque(arm, q) + FRICTION[:n] * np.tanh(qd / 0.004) + 0.5 * qd
    if more is not None:
        tau = tau + more(q, qd, t)
    tau = gains * (tau + noise * rng.standard_normal(q.shape))
    return JointSamples.single_run(arm.joints, t, q, qd, tau)


def frictionless(q, qd, t):
    """Return the friction of `recorded`, negative."""
    return -FRICTION[:q.shape[1]] * np.tanh(qd / 0.004) - 0.5 * qd


@pytest.fixture(scope='module')
def model():
    return fit(recorded(), FitOptions('chain')).model


def only(samples):
    (fact,) = joint_gains(ArmFit(samples)).facts()
    assert fact.kind is Kind.EFFORT_GAIN
    return fact


@pytest.mark.parametrize('factor', [0.1, *campaign(4.0)])
def test_a_unit_of_one_joint(factor):
    gains = np.ones(6)
    gains[2] = factor
    fact = only(recorded(gains))
    # Relative to the joint of the largest effort, which may be the one of another unit.
    if ARM.joints[2] in fact.values:
        assert fact.values == {ARM.joints[2]: pytest.approx(factor, rel=0.1)}
    else:
        assert fact.values[ARM.joints[1]] == pytest.approx(1 / factor, rel=0.1)


def test_a_unit_of_one_joint_in_one_of_two_recordings():
    gains = np.ones(6)
    gains[2] = 4.0
    right, wrong = recorded(seed=1), replace(recorded(gains), run_labels=('wrong.mcap',))
    (fact,) = torque_facts(concatenate([right, wrong]))
    assert fact.kind is Kind.EFFORT_GAIN and fact.action is Action.REFUSED
    assert fact.evidence.startswith('in wrong.mcap: ') and '--effort-scale' in fact.otherwise
    assert not torque_facts(concatenate([right, recorded(seed=2)]))


def test_smaller_gains_are_named_with_larger_ones_and_not_alone():
    gains = np.array([1.0, 1.0, 4.0, 1.3, 1.0, 1.0])
    assert only(recorded(gains)).values == {ARM.joints[1]: pytest.approx(0.25, rel=0.02),
                                            ARM.joints[3]: pytest.approx(1.3 / 4.0, rel=0.02),
                                            ARM.joints[4]: pytest.approx(0.25, rel=0.05)}
    gains[2] = 1.0
    assert joint_gains(ArmFit(recorded(gains))).facts() == []


def test_the_interval_contains_the_ratio_and_the_option_undoes_it():
    rated = np.array([300.0, 300.0, 150.0, 50.0, 50.0, 50.0])
    samples = recorded(1000.0 / rated)
    gains = joint_gains(ArmFit(samples))
    true = np.log(rated[gains.reference] / rated)
    known = gains.std < 0.1
    assert known.sum() >= 3
    assert (np.abs(gains.log - true)[known] < 0.02 + 4 * gains.std[known]).all()
    (fact,) = gains.facts()
    scales = dict(part.split('=') for part in fact.otherwise.split()[1].split(','))
    for n, name in enumerate(ARM.joints):
        if name in scales:
            assert float(scales[name]) == pytest.approx(np.exp(-true[n]), rel=0.15)


@pytest.mark.parametrize('seed, constants', [(1, (5, 3)), *campaign((2, (1, 4)))])
def test_torque_constants_of_two_parallel_joints(seed, constants):
    # Axes of 90, 0 degrees; the efforts are currents of motors with different constants.
    rng, t = np.random.default_rng(seed), np.arange(6000) / 50.0
    q, qd = np.zeros((2, len(t), 3))
    for joint in range(3):
        for size, omega in zip(rng.uniform(0.14, 0.35, 3), rng.uniform(0.08, 0.22, 3)):
            phase = rng.uniform(0, 2 * np.pi)
            q[:, joint] += size * np.sin(omega * t + phase)
            qd[:, joint] += size * omega * np.cos(omega * t + phase)
    fore = 5.0 * np.sin(q[:, 1] + q[:, 2])
    tau = np.column_stack([0 * t, 12.0 * np.sin(q[:, 1]) + fore, fore])
    tau += 0.5 * np.tanh(qd / 0.003) + 0.03 * rng.standard_normal(tau.shape)
    first, second = constants
    fact = only(JointSamples.single_run('abc', t, q, qd, tau / [5.0, first, second]))
    # Relative to the joint of the largest effort.
    ratio = second / first
    assert fact.values in ({'b': pytest.approx(ratio, rel=0.02)},
                           {'c': pytest.approx(1.0 / ratio, rel=0.02)})


@pytest.mark.parametrize('name, more', [
    ('body from 50 s on', lambda q, qd, t: (t > 50)[:, None] * (gravity_torque(
        HEAVY, q) - gravity_torque(ARM, q))),
    ('contact', lambda q, qd, t: 20.0 * ((t > 50) & (t < 53))[:, None] + 0 * q),
    *campaign(
        ('spring', lambda q, qd, t: np.array([0, 0, 15.0, 0, 0, 0]) * (q - 0.5)),
        ('gain', lambda q, qd, t: np.array([0, 0, 0.1, -0.1, 0, 0]) * gravity_torque(ARM, q)),
        ('drift and ripple', lambda q, qd, t: 0.03 * t[:, None] + 0.8 * np.sin(30 * q)),
        ('load', lambda q, qd, t: 0.1 * np.abs(gravity_torque(ARM, q)) * np.tanh(qd / 0.004) - 2)),
])
def test_other_effects_are_neither(name, more):
    assert_neither(ArmFit(recorded(more=more)))


def assert_neither(fit):
    base = moved_base(fit)
    assert joint_gains(fit).facts() == [] and (base is None or base.facts() == [])


def test_a_random_arm_has_no_fact():
    assert_neither(ArmFit(recorded(arm=serial_arm(6))))


def turned(pitch, begin, seconds, q, t):
    """Return the change of gravity by a base that turns by `pitch` rad, in ten steps."""
    gravity = gravity_torque(ARM, q)
    change, share = np.zeros_like(q), np.clip((t - begin) / seconds, 0.0, 1.0)
    for step in np.linspace(0.1, 1.0, 10):
        rows = np.abs(share - step) <= 0.05 + 1e-9
        change[rows] = gravity_torque(with_base_tilt(ARM, 0.3 * step * pitch, step * pitch),
                                      q[rows]) - gravity[rows]
    return change


@pytest.mark.parametrize('pitch, begin, seconds', [
    (0.12, 50.0, 0.1), *campaign((-0.4, 20.0, 15.0))])
def test_a_base_that_turns(pitch, begin, seconds):
    fit = ArmFit(recorded(more=lambda q, qd, t: turned(pitch, begin, seconds, q, t)))
    (fact,) = moved_base(fit).facts()
    assert (fact.kind, fact.action) == (Kind.MOVED_BASE, Action.REFUSED)
    (tilt,) = moved_base(fit).tilts
    assert tilt.angle == pytest.approx(abs(pitch) * np.hypot(1.0, 0.3), rel=0.1)
    assert (tilt.begin, tilt.end) == pytest.approx((begin, begin + seconds), abs=2.0)
    assert f'by {np.degrees(tilt.angle):.0f}° from' in fact.evidence


def test_a_base_that_turns_between_recordings():
    second = recorded(seed=3, more=lambda q, qd, t: 1.0 + turned(0.3, -1.0, 0.1, q, t))
    (fact,) = torque_facts(concatenate([recorded(), second]))
    assert fact.kind is Kind.MOVED_BASE and 'by 18°' in fact.evidence


@pytest.fixture(scope='module')
def wrist(tmp_path_factory):
    """Return a recording in which one joint tilts the others once, and the names of the others."""
    samples = recorded()
    q, qd = samples.q.copy(), samples.qd.copy()
    share = np.clip((samples.t - 50.0) / 6.0, 0.0, 1.0)
    q[:, :2] = [0.2, -0.9] + np.outer(share, [0.0, 0.5])
    qd[:, :2] = np.gradient(q[:, :2], samples.t, axis=0)
    tau = samples.tau + gravity_torque(ARM, q) - gravity_torque(ARM, samples.q)
    path = str(tmp_path_factory.mktemp('wrist') / 'wrist.mcap')
    write_bag(path, [joint_states(replace(samples, q=q, qd=qd, tau=tau))])
    return path, ARM.joints[2:]


@pytest.mark.parametrize('n_joints, offset', [(2, 0.0), (3, 1.0), *campaign((6, 4.0))])
@pytest.mark.parametrize('seed', [0, *campaign(1, 2)])
def test_friction_and_offset_of_one_recording_are_no_tilt(n_joints, offset, seed):
    arm = serial_arm(n_joints, seed)
    first = recorded(arm=arm, seed=seed, more=frictionless)
    second = recorded(arm=arm, seed=seed + 20, more=lambda q, qd, t: offset + (
        frictionless(q, qd, t) if offset else 0.0))
    assert torque_facts(concatenate([first, second])) == []


def test_a_part_of_an_arm_stands_on_a_link_that_tilts(wrist, tmp_path, capsys):
    path, joints = wrist
    part = read_bag(Path(path), ReadOptions(joints=joints)).samples
    named = ('--joints', ','.join(joints))
    assert main(['info', path, *named]) == 0
    assert 'refused' not in capsys.readouterr().out
    # Without the joint that tilts them in the recording, the base moved.
    alone = str(tmp_path / 'alone.mcap')
    write_bag(alone, [joint_states(part)])
    assert main(['fit', alone, *named]) == 1
    assert 'the vertical changes by 2' in capsys.readouterr().err


def test_an_arm_with_effort_on_one_joint_alone_has_no_gains():
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (600, 2))
    samples = JointSamples.single_run(('a', 'b'), 0.2 * np.arange(600), q, 0.0 * q,
                                      np.column_stack([np.zeros(600), 5.0 * np.sin(q[:, 1])]))
    assert joint_gains(ArmFit(samples)).facts() == [] == torque_facts(samples)


def test_the_reference_explains_its_own_effort(model):
    """A wrist with little gravity agrees best with the model, but is no reference."""
    gains = np.array([4.0, 4.0, 4.0, 1.0, 1.0, 1.0])
    (fact,) = torque_facts(recorded(gains, seed=1), None, model)
    assert fact.joints == ARM.joints[:3]
    assert list(fact.values.values()) == pytest.approx([4.0] * 3, rel=0.05)


def test_too_little_motion_has_no_result():
    samples = recorded()
    assert not moves_enough(samples.select(np.arange(60)))
    still = JointSamples.single_run(samples.names, samples.t, 0 * samples.q, 0 * samples.q,
                                    samples.tau)
    assert not moves_enough(still)


def test_an_update_with_another_unit_or_direction_is_refused(model, tmp_path, capsys):
    paths = [str(tmp_path / f'{k}.mcap') for k in range(2)]
    for k, gains in enumerate((np.array([4.0, 4.0, 4.0, 1.0, 1.0, 1.0]), 100.0)):
        write_bag(paths[k], [joint_states(recorded(gains, seed=k + 1))])
    file = tmp_path / 'arm.json'
    save_model(file, model)
    before = file.read_bytes()
    assert main(['update', paths[0], '--model', str(file)]) == 1
    error = capsys.readouterr().err
    assert 'gains disagree' in error and 'A payload changes no axis, no gain' in error
    # Relative to joints that agree with the model.
    assert f'{ARM.joints[1]}=0.2' in error and file.read_bytes() == before
    # The vertical axis carries no gravity: its friction is four times that of the model.
    assert re.search(rf'{ARM.joints[0]} has (3.9\d|4(.0\d)?) times.* by its friction', error)
    assert main(['update', paths[1], '--model', str(file)]) == 1
    error = ' '.join(capsys.readouterr().err.split())
    assert re.search('efforts of every joint are (99.[5-9]|100) times those of the earlier', error)
    assert f'{ARM.joints[0]}=0.01,' in error and file.read_bytes() == before
    # Neither does a payload reverse an axis.
    sign = np.array([1, 1, -1, 1, 1, 1])
    samples = recorded(arm=HEAVY, seed=1)
    write_bag(paths[0], [joint_states(replace(samples, q=sign * samples.q, qd=sign * samples.qd,
                                              tau=sign * samples.tau))])
    assert main(['update', paths[0], '--model', str(file)]) == 1
    error = capsys.readouterr().err
    assert f'--reverse {ARM.joints[2]}' in error and 'the earlier model' in error
    assert main(['update', paths[0], '--model', str(file), '--reverse', ARM.joints[2]]) == 0


def test_a_payload_that_doubles_all_gravity_is_no_unit():
    first, later = (replace(each, tau=each.tau + [0.0, 0.3] * np.tanh(each.qd / 0.005))
                    for each in (two_links(k) for k in (3, 4)))
    model = fit(first).model
    for factor in (0.1, 2.0, 10.2):
        (fact,) = common_gain(model, replace(later, tau=factor * later.tau))
        assert fact.values['elbow'] == pytest.approx(factor, rel=0.02)
    assert common_gain(model, replace(later, tau=1.2 * later.tau)) == []
    for payload in (0.5, 1.0, 5.0):
        heavier = replace(later, tau=later.tau + payload * model.predict(later.q))
        assert common_gain(model, heavier) == []
        # A payload in another unit: the factor is that of friction.
        (fact,) = common_gain(model, replace(heavier, tau=100 * heavier.tau))
        assert fact.values['elbow'] == pytest.approx(100.0, rel=0.02)


def test_a_gain_that_no_payload_explains_is_refused_by_update_alone(model):
    gains = np.ones(6)
    gains[2] = 1.3
    samples = recorded(gains, arm=HEAVY, seed=1)
    (fact,) = torque_facts(samples, None, model, min_ratio=OPTIONS.min_error)
    assert fact.values == {ARM.joints[2]: pytest.approx(1.3, rel=0.02)}
    # `diagnose` has an effect for it.
    assert torque_facts(samples, None, model) == []
    assert torque_facts(recorded(arm=HEAVY, seed=1), None, model,
                        min_ratio=OPTIONS.min_error) == []
    # A gain that the earlier model has is no change.
    same = fit(recorded(gains, frictionless), FitOptions('chain')).model
    assert torque_facts(samples, None, same, min_ratio=OPTIONS.min_error) == []
