"""Joint order against the names, axes against the description, and angles in degrees."""

from dataclasses import replace
import re

from bench.shared.campaign import campaign
import gravity_comp_ros as gc
from gravity_comp_ros.api import steps
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import BagError, DataError
from gravity_comp_ros.estimation import axis_directions
from gravity_comp_ros.estimation.arm_fit import ArmFit
from gravity_comp_ros.estimation.axis_directions import joint_order_from_torques
from gravity_comp_ros.estimation.torque_facts import torque_facts
from gravity_comp_ros.facts.fact import Kind
from gravity_comp_ros.models.kinematic.chain import aligned, Chain
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import numpy as np
import pytest

NAMES = ('pan', 'lift', 'elbow', 'wrist_1', 'wrist_2', 'wrist_3')
ABOUT_X = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
BACK = ABOUT_X.T
# Vertical, horizontal, horizontal, along the arm, across, along.
ROTATIONS = np.array([np.eye(3), ABOUT_X, np.eye(3), BACK, ABOUT_X, BACK])
# Moments of the links, N·m.
MOMENTS = -np.array([[0, 0], [52, 4], [18, 5], [0.3, 0], [2.2, 1.1], [0.2, 0.4]])


def arm(seed=0, noise=0.05):
    """Return slow samples of the arm, with friction."""
    rng = np.random.default_rng(seed)
    t = np.arange(3000) / 50
    omega, phase = rng.uniform(0.1, 0.25, 6), rng.uniform(0, 6, 6)
    q = rng.uniform(-0.7, 0.7, 6) + 0.6 * np.sin(omega * t[:, None] + phase)
    qd = 0.6 * omega * np.cos(omega * t[:, None] + phase)
    tau = Chain(ROTATIONS, MOMENTS).torque(q)
    tau = tau + np.array([1.5, 1.5, 1, 0.5, 0.4, 0.3]) * np.tanh(qd / 0.004) + 0.5 * qd
    tau = tau + noise * rng.standard_normal(q.shape)
    return JointSamples.single_run(NAMES, t, q, qd, tau)


def axis_facts(samples):
    return axis_directions.axis_facts(ArmFit(samples, ROTATIONS), ROTATIONS)


def test_an_arm_as_described_has_no_facts():
    samples = arm()
    assert axis_facts(samples) == [] and torque_facts(samples, by_name=True) == []


@pytest.mark.parametrize('joint', [1, *campaign(2, 4)])
def test_a_reversed_axis_is_named(joint):
    sign = np.ones(6)
    sign[joint] = -1.0
    samples = arm()
    turned = replace(samples, q=sign * samples.q, qd=sign * samples.qd, tau=sign * samples.tau)
    (fact,) = axis_facts(turned)
    assert fact.kind is Kind.AXES and f'--reverse {NAMES[joint]}' in fact.otherwise


def test_another_zero_is_named():
    samples = arm()
    q = samples.q.copy()
    q[:, 2] += np.pi / 2
    (fact,) = axis_facts(replace(samples, q=q))
    # Parallel axes: the zero of the joint before has equal torques.
    for name, zero in fact.values.items():
        q[:, NAMES.index(name)] -= zero
    assert fact.values and axis_facts(replace(samples, q=q)) == []


def test_the_options_correct_the_recording(tmp_path):
    samples = arm()
    sign = np.array([1, 1, 1, 1, -1, 1.0])
    q = sign * samples.q + [0, 0, 1.5708, 0, 0, 0]
    path = tmp_path / 'x.mcap'
    write_bag(path, [joint_states(replace(samples, q=q, qd=sign * samples.qd,
                                          tau=sign * samples.tau))])
    read = read_bag(path, ReadOptions(reverse=('wrist_2',), zero={'3': 1.5708})).samples
    for name in ('q', 'qd', 'tau'):
        np.testing.assert_allclose(getattr(read, name), getattr(samples, name), atol=1e-12)
    assert axis_facts(read) == []


def reached(*_):
    raise NotImplementedError('reached')


@pytest.mark.parametrize(('names', 'labels'), [
    # Three joints change places: neither a pair, nor its own inverse.
    (('s0', 's1', 'e0', 'e1', 'w0', 'w1'), ('e0', 'e1', 's0', 's1', 'w0', 'w1')),
    *campaign((NAMES, ('elbow', 'lift', 'pan', 'wrist_1', 'wrist_2', 'wrist_3')),
              (('base', 'shoulder', 'fore', 'elbow', 'wrist_1', 'wrist_2'),
               ('base', 'elbow', 'fore', 'shoulder', 'wrist_1', 'wrist_2')))])
def test_values_in_another_order_than_the_names_are_refused(names, labels, tmp_path,
                                                            monkeypatch):
    samples = replace(arm(), names=names)
    recorded = replace(samples.joints(labels), names=names)
    write_bag(tmp_path / 'x.mcap', [joint_states(recorded)])
    with pytest.raises(DataError, match='in another order than the names') as refusal:
        gc.fit(gc.read(tmp_path / 'x.mcap'))
    pairs = re.search(r'--rename (\S+), or', str(refusal.value))[1]
    renames = dict(pair.split('=') for pair in pairs.split(','))
    assert [renames.get(name, name) for name in names] == list(labels)
    # The order of joints that the user names is not judged. (The fit itself is slow.)
    monkeypatch.setattr(steps, 'fit_model', reached)
    with pytest.raises(NotImplementedError, match='reached'):
        gc.fit(gc.read(tmp_path / 'x.mcap', joints=names))


def test_an_arm_on_a_wall_is_in_order():
    samples = arm()
    wall = ROTATIONS.copy()
    wall[0] = ABOUT_X
    tau = samples.tau + (Chain(wall, MOMENTS).torque(samples.q)
                         - Chain(ROTATIONS, MOMENTS).torque(samples.q))
    assert torque_facts(replace(samples, tau=tau), by_name=True) == []


def test_small_degrees_are_refused(tmp_path):
    samples = arm(1)
    narrow = 0.15 * samples.q
    tau = Chain(ROTATIONS, MOMENTS).torque(narrow) + np.tanh(samples.qd / 0.004)
    degrees = replace(samples, q=np.degrees(narrow), qd=np.degrees(0.15 * samples.qd), tau=tau)
    assert np.abs(degrees.q).max() < 4 * np.pi
    path = tmp_path / 'x.mcap'
    write_bag(path, [joint_states(degrees)])
    with pytest.raises(BagError, match='linear in angles .* are they degrees'):
        read_bag(path)
    assert read_bag(path, ReadOptions(position_unit='deg')).report.facts == ()


FOUR = ('a', 'b', 'c', 'd')


def four_joints(seed):
    """Return slow motion of an arm of four joints at right angles, with friction and noise."""
    rng = np.random.default_rng(seed)
    axes = np.stack([aligned(np.array(axis)) for axis in (
        (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))])
    chain = Chain(axes, np.array([[40.0, 5.0], [1.0, 20.0], [8.0, 2.0], [1.0, 3.0]]))
    t = np.arange(0.0, 90.0, 0.2)
    phase, speed = rng.uniform(0.0, 6.0, 4), rng.uniform(0.05, 0.11, 4)
    q = np.sin(np.outer(t, speed) * 2.0 + phase)
    qd = 2.0 * speed * np.cos(np.outer(t, speed) * 2.0 + phase)
    tau = chain.torque(q) + 0.5 * np.tanh(qd / 0.01) + 0.05 * rng.standard_normal(q.shape)
    return JointSamples.single_run(FOUR, t, q, qd, tau)


@pytest.mark.parametrize('seed', [0, *campaign(1, 2)])
def test_a_wrong_order_is_corrected(seed):
    samples = four_joints(seed)
    shuffled = list(np.random.default_rng(seed + 100).permutation(FOUR))
    if tuple(shuffled) == FOUR:
        shuffled.reverse()
    assert joint_order_from_torques(samples.joints(shuffled)) == FOUR
    # The right order is kept.
    assert joint_order_from_torques(samples) is None
