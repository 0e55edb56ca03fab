"""`calibrate`: torque per unit of effort from a known weight, and the stiffness of servos."""

from dataclasses import replace
import json
from pathlib import Path

from bench.shared.command_line import refused
from bench.shared.rough_links import two_link_urdf, two_links
from gravity_comp_ros.calibration.known_weight import calibrate, CalibrationOptions, Weight
from gravity_comp_ros.calibration.servo_stiffness import held_goals, servo_stiffness
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.gate import slow_samples
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.description.links import described_arm
from gravity_comp_ros.errors import (
    BagError, DataError, GravityCompError, ModelMismatchError, OptionError)
from gravity_comp_ros.models.applied_effects import Applied, AppliedEffect, Quantity
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.node.outputs import position_offset
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.recordings.bag import joint_goals, read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import joint_states, JointTopic, write_bag
import numpy as np
import pytest

BAGS = Path(__file__).resolve().parents[3] / 'bags'
URDF = (BAGS / 'iiwa7.urdf').read_text()
JOINTS = tuple(f'iiwa_joint_{n}' for n in range(1, 8))
LINK = 'iiwa_link_7'
CONSTANTS = np.array([1.0, 0.7, -1.3, 0.05, 1.2, 40.0, 1.0])


@pytest.fixture(scope='module')
def bags():
    return [slow_samples(read_bag(BAGS / f'eq17_{name}.mcap').samples).samples
            for name in ('unloaded', '2kg')]


@pytest.fixture(scope='module')
def arm():
    return described_arm(URDF, JOINTS)


def as_efforts(samples):
    """Return the samples in units of effort: torque over N·m per unit."""
    return replace(samples, tau=samples.tau / CONSTANTS)


@pytest.mark.parametrize('centre', [None, (0.0, 0.0, 0.1)])
def test_constants_of_any_size_and_sign(bags, arm, centre):
    empty, loaded = map(as_efforts, bags)
    result = calibrate(empty, loaded, arm, Weight(LINK, 2.0, centre))
    assert {'iiwa_joint_2', 'iiwa_joint_3', 'iiwa_joint_4', 'iiwa_joint_6'} <= set(result.scales)
    assert {'iiwa_joint_1', 'iiwa_joint_7'} <= set(result.left_out)
    for joint, scale in result.scales.items():
        true = CONSTANTS[JOINTS.index(joint)]
        low, high = scale.ci95
        assert scale.value == pytest.approx(true, rel=0.02) and low < true < high, joint
    assert result.centre['z'].value == pytest.approx(0.1, abs=0.005)


def test_one_joint_by_hand():
    # A pendulum of first moment 1.2 kg m; 2 kg at 0.5 m beyond; effort = torque / 0.3, no noise.
    # The inertia of the weight counts: 0.2 m/s² are two hundredths of gravity.
    text = ('<robot name="p"><link name="b"/><link name="l"/><joint name="j" type="revolute">'
            '<parent link="b"/><child link="l"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" '
            'effort="1" velocity="1"/></joint></robot>')
    arm, t = described_arm(text, ['j']), np.arange(0.0, 60.0, 0.2)
    parts = []
    for mass in (0.0, 2.0):
        q = np.sin(0.4 * t + mass)[:, None]
        qd = 0.4 * np.cos(0.4 * t + mass)[:, None]
        torque = (9.80665 * (1.2 + 0.5 * mass) * np.sin(q) - 0.5 ** 2 * mass * 0.4 ** 2 * q
                  + 0.7 + 0.2 * np.sign(qd))
        parts.append(JointSamples.single_run(('j',), t, q, qd, torque / 0.3))
    # Hanging along -z at angle 0: the weight is at z = -0.5.
    result = calibrate(*parts, arm, Weight('l', 2.0, (0.0, 0.0, -0.5)))
    assert result.scales['j'].value == pytest.approx(0.3, rel=1e-5)


@pytest.mark.parametrize('reach', [0.6, 1.4])
def test_more_motion_gives_no_larger_intervals_of_an_unknown_centre(reach):
    """A fit from the prior mean of the centre, on the axis of the elbow, ended at other gains."""
    arm = described_arm(two_link_urdf(masses=(1.53, 1.02)), ('shoulder', 'elbow'))
    loaded = two_links(3, reach=reach)
    lever = 0.4 * STANDARD_GRAVITY
    both = lever * np.sin(loaded.q.sum(axis=1))
    loaded = replace(loaded, tau=loaded.tau + np.column_stack(
        [both + lever * np.sin(loaded.q[:, 0]), both]))
    result = calibrate(two_links(1, reach=reach), loaded, arm, Weight('l2', 1.0))
    for joint in ('shoulder', 'elbow'):
        scale = result.scales[joint]
        assert scale.ci95[0] < 1.0 < scale.ci95[1] and scale.half < 0.03
    assert result.centre['z'].value == pytest.approx(-0.4, abs=0.01)


def test_what_cannot_be_calibrated_is_refused(bags, arm):
    empty, loaded = bags
    with pytest.raises(DataError, match='the effort of no joint'):
        calibrate(empty, slow_samples(read_bag(BAGS / 'eq17_later.mcap').samples).samples, arm,
                  Weight(LINK, 2.0))
    with pytest.raises(DataError, match='with weight has 20'):
        calibrate(empty, loaded.select(np.arange(20)), arm, Weight(LINK, 2.0))
    with pytest.raises(GravityCompError, match='carries no link tool'):
        calibrate(empty, loaded, arm, Weight('tool', 2.0))


def test_one_offset_for_both_recordings_gives_smaller_intervals(bags, arm):
    free, same = (calibrate(*bags, arm, Weight(LINK, 2.0), CalibrationOptions(same_offset=same))
                  for same in (False, True))
    for joint in ('iiwa_joint_2', 'iiwa_joint_4'):
        assert np.ptp(same.scales[joint].ci95) < 0.95 * np.ptp(free.scales[joint].ci95)
        assert same.scales[joint].value == pytest.approx(1.0, abs=0.01)


@pytest.fixture
def recordings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, stem in (('empty', 'unloaded'), ('loaded', '2kg')):
        samples = read_bag(BAGS / f'eq17_{stem}.mcap').samples
        write_bag(tmp_path / f'{name}.mcap', [joint_states(as_efforts(samples))])
    return ['calibrate', 'empty.mcap', 'loaded.mcap', '--mass', '2', '--urdf',
            str(BAGS / 'iiwa7.urdf')]


def test_the_printed_option_calibrates(recordings, capsys):
    assert main([*recordings, '--json', 'r.json']) == 0
    assert 'centre of mass of the weight in the frame of iiwa_link_7' in capsys.readouterr().out
    option = json.loads(Path('r.json').read_text())['option']
    assert main([*recordings, *option.split(), '--json', 'again.json']) == 0
    first, again = (json.loads(Path(name).read_text())['joints'] for name in (
        'r.json', 'again.json'))
    for joint in first:
        assert again[joint]['scale']['value'] == pytest.approx(first[joint]['scale']['value'],
                                                               rel=1e-3)


def test_the_printed_option_replaces_a_unit(recordings, capsys):
    assert main(recordings) == 0
    *_, plain = capsys.readouterr().out.splitlines()
    assert main([*recordings, '--effort-unit', 'mNm']) == 0
    *_, text, option = capsys.readouterr().out.splitlines()
    assert option == plain and 'instead of --effort-unit' in text


def test_numbers_of_joints_are_those_of_the_first_recording(recordings):
    samples = read_bag('loaded.mcap').samples
    write_bag('loaded.mcap', [joint_states(samples.joints(samples.names[::-1]))])
    for joint in ('2', 'iiwa_joint_2'):
        assert main([*recordings, '--effort-scale', f'{joint}=-2', '--json', f'{joint}.json']) == 0
    numbered, named = (json.loads(Path(name).read_text())['joints'] for name in (
        '2.json', 'iiwa_joint_2.json'))
    assert numbered == named
    for joint in named.values():
        low, high = joint['scale']['ci95']
        assert low < joint['scale']['value'] < high


@pytest.mark.parametrize(('change', 'message'), [
    (lambda a: [*a, '--link', 'tool9'], 'carries no link tool9'),
    (lambda a: [a[0], a[2], a[1], *a[3:]], 'the arm would weigh -1.2'),
    (lambda a: [*a[:4], '1e9', *a[5:]], 'check the mass')])
def test_a_weight_that_cannot_be_is_refused(recordings, capsys, change, message):
    assert message in refused(capsys, *change(recordings))


STIFFNESS = np.array([150.0, 60.0])
SERVOS = ('shoulder', 'elbow')


def model(joints=SERVOS):
    """Return tau = (8 sin q_1, 3 sin q_2)."""
    torques = tuple(Expansion(np.array([k]), np.array([w])) for k, w in ((3, 8.0), (1, 3.0)))
    return GravityModel(joints, 'per_joint', torques, None, np.full(2, 0.1),
                        Coverage(np.full(2, -1.5), np.full(2, 1.5), 100))


def servos(stiffness=STIFFNESS, joints=SERVOS, friction=0.2):
    """Return slow motion of servos, and their goals: 0.05 rad of offset and 20 ms of delay."""
    t = np.arange(0.0, 60.0, 0.1)
    q = np.column_stack([1.2 * np.sin(0.1 * t), 1.2 * np.sin(0.13 * t + 1.0)])
    qd = np.gradient(q, 0.1, axis=0)
    tau = model(joints).predict(q) + friction * np.sign(qd)
    noise = 1e-4 * np.random.default_rng(0).normal(size=q.shape)
    return (JointSamples.single_run(joints, t, q, qd, tau),
            q + tau / stiffness + 0.05 + 0.02 * qd + noise)


def test_the_stiffness_is_found_in_spite_of_friction_delay_and_offset():
    result = servo_stiffness(model(), *servos())
    for joint, true in zip(SERVOS, STIFFNESS):
        measured = result.stiffness[joint]
        assert measured.value == pytest.approx(true, rel=0.02) and measured.unit == 'N·m/rad'
        assert measured.ci95[0] < true < measured.ci95[1]
    assert not result.left_out
    assert result.sag['shoulder'] > 10 * result.rmse['shoulder']


def test_the_torque_includes_a_spring_that_the_model_found():
    k = AppliedEffect('joint_spring', 'elbow', {'centre': 0.0, 'overtones': 0.0}, {
        'k': Quantity(6.0, 'N·m/rad', (5.9, 6.1)), 'm': Quantity(0.0, 'N·m', (-0.1, 0.1))})
    samples, goal = servos()
    goal[:, 1] += 6.0 * samples.q[:, 1] / STIFFNESS[1]
    result = servo_stiffness(replace(model(), fitted=Applied((k,))), samples, goal)
    assert result.stiffness['elbow'].value == pytest.approx(STIFFNESS[1], rel=0.02)


def test_a_joint_with_an_integral_part_or_a_wrong_sign_is_left_out():
    samples, goal = servos()
    goal[:, 1] = samples.q[:, 1] + 1e-4 * np.random.default_rng(1).normal(size=len(goal))
    result = servo_stiffness(model(), samples, goal)
    assert list(result.stiffness) == ['shoulder'] and 'integral' in result.left_out['elbow']
    result = servo_stiffness(model(), *servos(np.array([150.0, -60.0])))
    assert list(result.stiffness) == ['shoulder'] and 'signs' in result.left_out['elbow']
    with pytest.raises(DataError, match='no stiffness: shoulder'):
        servo_stiffness(model(), *servos(-STIFFNESS))


@pytest.mark.parametrize('size', [0.0, 1e-8, 1e-3])
def test_a_joint_with_hardly_any_torque_is_left_out(size):
    samples, goal = servos()
    torques = (model().torques[0], Expansion(np.array([1]), np.array([size])))
    goal[:, 1] = samples.q[:, 1] + 1e-3 * np.random.default_rng(1).normal(size=len(goal))
    result = servo_stiffness(replace(model(), torques=torques), samples, goal)
    assert list(result.stiffness) == ['shoulder'] and 'hardly changes' in result.left_out['elbow']


def test_unusable_goals_are_refused():
    samples, goal = servos()
    with pytest.raises(DataError, match='shape'):
        servo_stiffness(model(), samples, goal[:, :1])
    goal[30:] = np.nan
    with pytest.raises(DataError, match='30 slow samples have a goal of every joint; at least 50'):
        servo_stiffness(model(), samples, goal)
    with pytest.raises(ModelMismatchError):
        servo_stiffness(model(('a', 'b')), samples, goal)


def test_a_goal_is_in_force_until_the_next_one():
    held = held_goals(np.array([0.5, 1.0, 1.9, 5.0]), np.array([1.0, 2.0]),
                      np.array([[1.0], [2.0]]))
    np.testing.assert_array_equal(held, [[np.nan], [1.0], [1.0], [2.0]])


def test_the_offset_is_torque_by_stiffness_and_limited():
    offset = position_offset(np.array([15.0, -60.0]), STIFFNESS, 0.2)
    np.testing.assert_allclose(offset, [0.1, -0.2])
    np.testing.assert_allclose(position_offset(np.array([3.0, -6.0]), np.array([60.0]), 0.2),
                               [0.05, -0.1])


@pytest.mark.parametrize(('values', 'reason'), [
    ((0.0,), 'must lie in'), ((-5.0,), 'must lie in'), ((float('nan'),), 'finite'),
    ((float('inf'),), 'finite'), ((1e7,), 'must lie in'),
    ((100.0, 50.0), '2 values for 3 joints')])
def test_a_stiffness_that_cannot_be_is_refused(values, reason):
    with pytest.raises(OptionError, match=f'servo_stiffness.*{reason}'):
        Parameters(joints=('a', 'b', 'c'), servo_stiffness=values)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with a model, a recording with goals, and one with other goals."""
    monkeypatch.chdir(tmp_path)
    samples, goal = servos()
    samples = replace(samples, names=two_links(1).names)
    save_model(tmp_path / 'm.json', model(samples.names))
    state = joint_states(samples)
    write_bag(tmp_path / 'a.mcap', [state, JointTopic('/goals', samples.names, samples.t, goal),
                                    JointTopic('/other', ('x',), samples.t, goal[:, :1])])
    return tmp_path


def test_the_verb_prints_the_parameter(folder, capsys):
    command = ['calibrate', 'a.mcap', '--goals', '/goals', '--model', 'm.json']
    assert main(command) == 0
    assert 'servo_stiffness: [1' in capsys.readouterr().out
    assert main([*command, '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    values = json.loads(document['option'].removeprefix('servo_stiffness: '))
    assert values == pytest.approx(STIFFNESS, rel=0.02)
    assert Parameters(joints=tuple(document['joints']), servo_stiffness=tuple(values))
    assert 'no joint' in refused(capsys, *command[:3], '/other', *command[4:])


def test_goals_have_the_signs_and_zeros_of_the_positions(folder):
    names = two_links(1).names
    plain = joint_goals(folder / 'a.mcap', '/goals', names)[1]
    turned = joint_goals(folder / 'a.mcap', '/goals', names, ReadOptions(
        reverse=names[:1], zero={names[1]: 0.5}, position_unit='rad'))[1]
    np.testing.assert_allclose(turned, np.column_stack([-plain[:, 0], plain[:, 1] - 0.5]))
    with pytest.raises(BagError, match='no topic'):
        joint_goals(folder / 'a.mcap', '/x', names)
