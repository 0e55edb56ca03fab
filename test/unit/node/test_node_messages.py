"""
Messages of the input: conversion to vectors, and faults, which cause no wrong torque.

After each fault every torque is that of the model at the pose of its message, the next valid
message is answered, and the status `input` counts the fault by its reason.
"""

from pathlib import Path

from bench.shared.node_messages import joint_state, send_message
from gravity_comp_ros.node.diagnostics import WARN
from gravity_comp_ros.node.messages import JointStateReader
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.recordings.bag import read_bag
from hypothesis import example, given, settings, strategies as st
import numpy as np
import pytest

NAN, INF = float('nan'), float('inf')


def state(t=1.0, names=('a', 'b'), q=(0.1, 0.2), qd=(0.0, 0.0), tau=(1.0, 2.0)):
    return joint_state(names, t, q, qd, tau)


def reader(**options):
    return JointStateReader(('a', 'b'), **options)


def test_order_of_the_message_does_not_matter():
    ours = reader()
    assert ours.read(state(0.5), 0.0) is not None
    reading = ours.read(state(
        names=('b', 'gripper', 'a'), q=(2, NAN, 1), qd=(20, 90, 10), tau=(200, 900, 100)), 0.0)
    np.testing.assert_array_equal(reading.q, [1, 2])
    np.testing.assert_array_equal(reading.qd, [10, 20])
    np.testing.assert_array_equal(reading.tau, [100, 200])


def test_scale_converts_units_and_sign():
    reading = reader(effort_scale=(-2.0, 0.5)).read(state(), 0.0)
    np.testing.assert_array_equal(reading.tau, [-2.0, 1.0])
    # Finite numbers whose product with the scale is not.
    ours = reader(effort_scale=(10.0,))
    assert ours.read(state(tau=(1e308, 1.0)), 0.0).tau is None
    assert ours.counts == {'effort_absurd': 1}


def test_velocity_is_the_slope_where_the_message_has_none():
    ours, results = reader(), []
    for k in range(30):
        t = 1.0 + 0.01 * k
        reading = ours.read(state(t, q=(0.05 * t, -0.1 * t), qd=()), 0.0)
        results.append(reading.qd)
    assert results[5] is None
    np.testing.assert_allclose(results[-1], [0.05, -0.1], atol=1e-9)
    # After a gap it is unknown.
    assert ours.read(state(9.0, q=(1.0, 1.0), qd=()), 0.0).qd is None


def test_a_constant_earlier_stamp_is_never_accepted():
    ours = reader()
    ours.read(state(100.0), 0.0)
    assert all(ours.read(state(7.0), 0.0) is None for _ in range(50))
    # Without a stamp the time of arrival is used.
    ours = reader()
    assert ours.read(state(0.0), 17.5).t == 17.5
    assert ours.counts == {'no_stamp': 1}


values = st.floats(allow_nan=True, allow_infinity=True, width=64)
names = st.lists(st.sampled_from(['a', 'b', 'c', '']), max_size=5)


# Reasons that are counted for used messages (and possibly for dropped ones).
NOT_DROPPED = {'no_stamp', 'clock_jump', 'no_velocity', 'no_effort'}


def dropped(ours):
    """Return the number of messages counted as dropped."""
    return sum(count for reason, count in ours.counts.items() if reason not in NOT_DROPPED)


@settings(max_examples=150)
@example([(['a', 'b'], [0.0, 0.0], [], [], 0)] * 2)
@given(st.lists(st.tuples(names, st.lists(values, max_size=5), st.lists(values, max_size=5),
                          st.lists(values, max_size=5), st.integers(0, 9)), max_size=12))
def test_no_message_can_break_the_reader(messages):
    ours, last = reader(), -np.inf
    for joint_names, q, qd, tau, t in messages:
        before = dropped(ours)
        reading = ours.read(state(float(t), joint_names, q, qd, tau), 20.0)
        if reading is None:
            assert dropped(ours) == before + 1
            continue
        assert np.isfinite(reading.q).all() and reading.q.shape == (2,)
        assert reading.qd is None or np.isfinite(reading.qd).all()
        assert reading.tau is None or np.isfinite(reading.tau).all()
        assert reading.t > last or reading.new_run
        last = reading.t


def one_joint(t, q=0.0, qd=0.0):
    return state(t, ('a',), (q,), (qd,), (1.0,))


def test_angles_in_degrees_are_dropped_except_for_continuous_joints():
    ours = JointStateReader(['a', 'b'], continuous=['b'])
    assert ours.read(state(1.0, q=(90.0, 0.0)), 0.0) is None
    assert ours.counts['position_absurd'] == 1
    assert ours.read(state(2.0, q=(9.4, 90.0)), 0.0) is not None


def test_a_velocity_that_positions_contradict_is_replaced():
    ours = JointStateReader(['a'])
    for k in range(60):
        reading = ours.read(one_joint(1.0 + 0.01 * k, 0.002 * k), 0.0)
    assert reading.qd == pytest.approx(0.2) and ours.counts['velocity_wrong'] > 40
    right = JointStateReader(['a'])
    for k in range(200):
        t = 1.0 + 0.01 * k
        reading = right.read(one_joint(t, np.sin(3 * t), 3 * np.cos(3 * t)), 0.0)
        assert reading.qd == pytest.approx(3 * np.cos(3 * t))
    assert not right.counts['velocity_wrong']


@pytest.mark.parametrize('has_velocity', [True, False])
def test_an_angle_that_the_driver_wraps_is_no_jump_of_the_joint(live, has_velocity):
    """Neither its velocity nor its acceleration is that of a whole revolution."""
    node, speed = live(joints=('a',), auto_fit=False), 0.12
    for k in range(200):
        q = (3.0 + speed * 0.01 * k + np.pi) % (2.0 * np.pi) - np.pi
        message = state(1.0 + 0.01 * k, ('a',), (q,), (speed,) * has_velocity, (1.0,))
        reading, _ = send_message(node, message, 0.01 * k)
        assert reading.qd is None or reading.qd == pytest.approx(speed)
    assert set(node.arm.reader.counts) <= {'no_velocity'}
    samples = node.arm.epoch.samples()
    assert len(samples) > 6
    for sample in samples:
        assert np.abs(sample.reading.q) > 2.9
        assert sample.qdd is None or np.abs(sample.qdd) < 1e-6


def test_a_stamp_of_zero_is_the_time_of_arrival():
    ours = JointStateReader(['a'])
    for k in range(10):
        ours.read(one_joint(100.0 + 0.1 * k), 5000.0 + 0.1 * k)
    results = [ours.read(one_joint(0.0), 5001.0 + 0.1 * k) for k in range(10)]
    np.testing.assert_allclose([each.t for each in results], 5001.0 + 0.1 * np.arange(10))
    assert ours.counts == {'no_stamp': 10}
    # Stamps of another clock begin a run, also those of a simulation that begins at 0.
    again = [ours.read(one_joint(102.0 + 0.1 * k), 5003.0) for k in range(3)]
    assert [each.new_run for each in again] == [True, False, False]


NAMES = [f'iiwa_joint_{k}' for k in range(1, 8)]
BAGS = Path(__file__).resolve().parents[3] / 'bags'
SEVEN = [0.1] * 7


class Field:
    """Sends the messages of a recording and faults among them, and checks each torque."""

    def __init__(self, model_file, recording):
        settings = Parameters(model_file=str(model_file), ramp_time=0.0, max_torque_rate=(),
                              max_torque=(176.0,), max_age=0.0, auto_fit=False)
        self.core = NodeCore(settings, '/joint_states', 0.0)
        self.recording, self.k, self.t, self.now = recording, 0, 100000.0, 0.0

    def message(self, **change):
        """Return the next valid joint state, or one with replaced fields."""
        self.k, self.t, self.now = self.k + 1, self.t + 0.2, self.now + 0.2
        row = self.k % len(self.recording)
        message = joint_state(NAMES, change.pop('t', self.t), self.recording.q[row],
                              self.recording.qd[row], self.recording.tau[row])
        for field, value in change.items():
            setattr(message, field, value)
        return message

    def send(self, message):
        """Send a message; return whether it was answered."""
        reading, tau = send_message(self.core, message, self.now, 5.0)
        if tau is None:
            return False
        places = [list(message.name).index(name) for name in NAMES]
        pose = np.array(message.position)[places]
        np.testing.assert_allclose(tau, self.core.models.model.predict_one(pose), atol=1e-9)
        np.testing.assert_array_equal(reading.q, pose)
        return True

    def status(self):
        return {each.name: each for each in self.core.statuses(self.now)}['input']

    def count(self, reason):
        return self.core.arm.reader.counts[reason]


@pytest.fixture(scope='module')
def field(iiwa_model_file):
    field = Field(iiwa_model_file, read_bag(BAGS / 'eq17_later.mcap').samples)
    assert field.send(field.message())
    yield field
    field.core.close()


# Replaced fields, the reason, and whether the message is answered.
FAULTS = {
    'no names': ({'name': []}, 'other_joints', False),
    'a missing joint': ({'name': NAMES[:6], 'position': SEVEN[:6]}, 'missing_joint', False),
    'a joint twice': ({'name': [*NAMES[:6], NAMES[0]]}, 'duplicate_joint', False),
    'no positions': ({'position': []}, 'wrong_size', False),
    'short positions': ({'position': SEVEN[:5]}, 'wrong_size', False),
    'NaN': ({'position': [*SEVEN[:6], NAN]}, 'position_not_finite', False),
    'infinite': ({'position': [INF, *SEVEN[:6]]}, 'position_not_finite', False),
    'an encoder fault': ({'position': [1e300, *SEVEN[:6]]}, 'position_absurd', False),
    'no effort': ({'effort': []}, 'no_effort', True),
    'short effort': ({'effort': [1.0]}, 'wrong_size', True),
    'infinite effort': ({'effort': [*SEVEN[:6], INF]}, 'effort_not_finite', True),
    'effort of uninitialised memory': ({'effort': [1e308, *SEVEN[:6]]}, 'effort_absurd', True),
    'no velocity': ({'velocity': []}, 'no_velocity', True),
    'velocity NaN': ({'velocity': [NAN, *SEVEN[:6]]}, 'velocity_not_finite', True),
}


@pytest.mark.parametrize('name', FAULTS)
def test_a_faulty_message_is_counted_and_causes_no_wrong_torque(field, name):
    change, reason, is_answered = FAULTS[name]
    before = field.count(reason)
    field.status()
    assert field.send(field.message(**change)) == is_answered
    assert field.count(reason) == before + 1
    report = field.status()
    assert report.values[f'count {reason}'] == str(before + 1)
    if reason not in ('other_joints', 'no_velocity'):
        assert report.level == WARN and f'{reason} 1' in report.message
    assert field.send(field.message()) and field.core.models.problem == ''


@pytest.mark.parametrize('shift, reason', [(0.0, 'time_still'), (-0.5, 'time_back'),
                                           (-900.0, 'time_back')])
def test_an_equal_or_earlier_stamp_is_dropped(field, shift, reason):
    before = field.count(reason)
    assert not field.send(field.message(t=field.t + shift))
    assert field.count(reason) == before + 1 and field.send(field.message())


@pytest.mark.parametrize('seconds', [-500.0, -9000.0])
def test_a_clock_that_is_set_back_is_accepted(field, seconds):
    before, field.t = field.count('clock_jump'), field.t + seconds
    answered = [field.send(field.message()) for _ in range(6)]
    assert answered == [False] * 4 + [True] * 2 and field.count('clock_jump') == before + 1
