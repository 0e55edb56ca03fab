"""Conversion of joint states to vectors, and the name of each fault."""

from bench.shared.node_messages import joint_state as message
from gravity_comp_ros.node.messages import JointStateReader
from hypothesis import example, given, settings, strategies as st
import numpy as np
import pytest

NAN, INF = float('nan'), float('inf')


def joint_state(t=1.0, names=('a', 'b'), q=(0.1, 0.2), qd=(0.0, 0.0), tau=(1.0, 2.0)):
    return message(names, t, q, qd, tau)


def reader(**options):
    return JointStateReader(('a', 'b'), **options)


def test_order_of_the_message_does_not_matter():
    ours = reader()
    assert ours.read(joint_state(0.5), 0.0) is not None
    reading = ours.read(joint_state(
        names=('b', 'gripper', 'a'), q=(2, 9, 1), qd=(20, 90, 10), tau=(200, 900, 100)), 0.0)
    np.testing.assert_array_equal(reading.q, [1, 2])
    np.testing.assert_array_equal(reading.qd, [10, 20])
    np.testing.assert_array_equal(reading.tau, [100, 200])


def test_scale_converts_units_and_sign():
    reading = reader(effort_scale=(-2.0, 0.5)).read(joint_state(), 0.0)
    np.testing.assert_array_equal(reading.tau, [-2.0, 1.0])
    # Finite numbers whose product with the scale is not.
    ours = reader(effort_scale=(10.0,))
    assert ours.read(joint_state(tau=(1e308, 1.0)), 0.0).tau is None
    assert ours.counts == {'effort_absurd': 1}


def test_velocity_is_the_slope_where_the_message_has_none():
    ours, results = reader(), []
    for k in range(30):
        t = 1.0 + 0.01 * k
        reading = ours.read(joint_state(t, q=(0.05 * t, -0.1 * t), qd=()), 0.0)
        results.append(reading.qd)
    assert results[5] is None
    np.testing.assert_allclose(results[-1], [0.05, -0.1], atol=1e-9)
    # After a gap it is unknown.
    assert ours.read(joint_state(9.0, q=(1.0, 1.0), qd=()), 0.0).qd is None


def test_a_constant_earlier_stamp_is_never_accepted():
    ours = reader()
    ours.read(joint_state(100.0), 0.0)
    assert all(ours.read(joint_state(7.0), 0.0) is None for _ in range(50))


def test_without_a_stamp_the_time_of_arrival_is_used():
    ours = reader()
    assert ours.read(joint_state(0.0), 17.5).t == 17.5
    assert ours.counts == {'no_stamp': 1}


def test_a_simulation_that_begins_at_zero_loses_nothing():
    ours = reader()
    readings = [ours.read(joint_state(0.1 * k), 1.7e9) for k in range(4)]
    assert [r.new_run for r in readings] == [False, True, False, False]
    assert ours.read(joint_state(0.0), 1.7e9 + 1) is None
    assert ours.counts == {'no_stamp': 1, 'time_back': 1}


values = st.floats(allow_nan=True, allow_infinity=True, width=64)
names = st.lists(st.sampled_from(['a', 'b', 'c', '']), max_size=5)


# Reasons that are counted for used messages (and possibly for dropped ones).
NOT_DROPPED = {'no_stamp', 'stamp_lost', 'clock_jump', 'no_velocity', 'no_effort'}


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
        reading = ours.read(joint_state(float(t), joint_names, q, qd, tau), 20.0)
        if reading is None:
            assert dropped(ours) == before + 1
            continue
        assert np.isfinite(reading.q).all() and reading.q.shape == (2,)
        assert reading.qd is None or np.isfinite(reading.qd).all()
        assert reading.tau is None or np.isfinite(reading.tau).all()
        assert reading.t > last or reading.new_run
        last = reading.t


def one_joint(t, q=0.0, qd=0.0):
    return joint_state(t, ('a',), (q,), (qd,), (1.0,))


def test_angles_in_degrees_are_dropped_except_for_continuous_joints():
    ours = JointStateReader(['a', 'b'], continuous=['b'])
    assert ours.read(joint_state(1.0, q=(90.0, 0.0)), 0.0) is None
    assert ours.counts['position_absurd'] == 1
    assert ours.read(joint_state(2.0, q=(9.4, 90.0)), 0.0) is not None


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


def test_lost_stamps_are_replaced_by_the_time_of_arrival():
    ours = JointStateReader(['a'])
    for k in range(10):
        ours.read(one_joint(100.0 + 0.1 * k), 5000.0 + 0.1 * k)
    results = [ours.read(one_joint(0.0), 5001.0 + 0.1 * k) for k in range(10)]
    assert [each is None for each in results] == [True] * 4 + [False] * 6
    assert results[4].new_run and results[5].t == pytest.approx(5001.5)
    assert ours.counts['stamp_lost'] == 1
    again = ours.read(one_joint(102.0), 5003.0)
    assert again.t == 102.0 and again.new_run
