"""`NodeCore` without ROS, with explicit messages and time: its input, torque and description."""

from dataclasses import replace

from bench.shared.node_messages import (
    feed, motion, refit, send_message, slow_state, status, torque, until)
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.node.arm import describe_arm, Kept
from gravity_comp_ros.node.diagnostics import ERROR, OK, STALE, WARN
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import Parameters
import numpy as np
import pytest


def test_it_learns_the_torque_and_publishes_it(live):
    node = live(ramp_time=0.0, max_torque_rate=())
    now = feed(node, 140)
    until(node, lambda: node.models.model is not None)
    last = slow_state(now + 0.2, [0.4, 0.1], [0.0, 0.0])
    reading, tau = send_message(node, last, now + 0.2, 0.0)
    np.testing.assert_allclose(tau, torque(np.array([0.4, 0.1])), atol=0.05)


@pytest.mark.parametrize('content', [b'', b'null', b'\x00\xff' * 99,
                                     b'{"format": "gravity_comp_ros model", "version": 99}'])
def test_files_that_are_no_model_are_reported_and_not_changed(live, content, tmp_path):
    path = tmp_path / 'model.json'
    path.write_bytes(content)
    node = live(model_file=str(path))
    assert status(node, 'model').level == ERROR
    assert send_message(node, slow_state(1.0, [0.1, 0.2], [0.0, 0.0]), 1.0, 0.0)[1] is None
    answers = []
    node.models.save(lambda *reply: answers.append(reply))
    assert not answers[0][0] and path.read_bytes() == content
    # The first message does not end the report.
    assert status(node, 'model').level == ERROR and 'model.json' in status(node, 'model').message


def test_a_path_that_cannot_be_read_is_reported(live):
    node = live(model_file='/tmp/' + 300 * 'm')
    assert node.models.model is None and 'too long' in status(node, 'model').message


def test_the_model_of_another_arm_is_not_used_and_not_replaced_unless_requested(
        live, model_file, tmp_path):
    path = tmp_path / 'model.json'
    path.write_bytes(model_file.read_bytes())
    node = live(model_file=str(path), joints=('b', 'a'), auto_save=True, auto_fit=False)
    assert node.models.model is None and status(node, 'model').level == ERROR
    feed(node, 200)
    assert refit(node)[0]
    node.models.close()
    assert path.read_bytes() == model_file.read_bytes()
    assert 'is a model of a, b' in status(node, 'model').message
    node.models.save(lambda *_: None)
    node.models.close()
    assert load_model(path).joints == ('b', 'a') and status(node, 'model').level == OK


def test_payload_changed_in_an_empty_epoch_drops_the_sample_that_waits(live, model_file):
    node = live(model_file=str(model_file), settle_time=0.1)
    t, q = motion(24)
    for k in range(24):
        if k == 20:
            node.learner.payload_changed(t[k] - 0.15)
        if k == 21:
            assert 'open already' in node.learner.payload_changed(t[k] - 0.15)[1]
            assert node.arm.epoch.number == 1 and len(node.arm.epoch) == 0
        send_message(node, slow_state(1.0 + t[k], q[k], torque(q[k])), t[k])
    # The last of three samples waits for later messages; the one before the call is gone.
    assert len(node.arm.epoch) == 2


def test_a_first_message_that_names_no_arm(live):
    node = live()
    names = [f'j{k}' for k in range(11)]
    large = slow_state(1.0, [0.0] * 11, [0.0] * 11, names)
    assert send_message(node, large, 1.0, 0.0) == (None, None)
    assert 'set the parameter joints' in status(node, 'model').message
    assert send_message(node, slow_state(2.0, [0.1, 0.2], [0.0, 0.0]), 2.0, 0.0)[0] is not None
    assert node.arm.joints == ('a', 'b') and status(node, 'model').level == WARN


def test_levels_of_the_input(live):
    node = live(joints=('a', 'b'))
    assert status(node, 'input').level == STALE
    send_message(node, slow_state(1.0, [0.1], [0.1], ['a']), 1.0, 0.0)
    assert status(node, 'input', 1.0).level == ERROR
    send_message(node, slow_state(1.1, [0.1, 0.2], [0.1, 0.2]), 1.1, 0.0)
    assert status(node, 'input', 1.1).level == OK
    assert status(node, 'input', 9.0).level == STALE


def test_a_large_residual_suggests_another_payload(live, model_file):
    node = live(model_file=str(model_file))
    now = feed(node, 40)
    quiet = status(node, 'joint a', now)
    assert quiet.level == OK and float(quiet.values['residual beside friction [Nm]']) < 0.02
    feed(node, 40, now + 0.2, mass=1.5)
    loud = status(node, 'joint a', now + 8.0)
    assert loud.level == WARN and 'another payload' in loud.message


@pytest.mark.parametrize('after', [0.2, -4990.0])
def test_nothing_is_learned_during_the_settle_time(live, model_file, after):
    """Also with a clock that is set back meanwhile; the last sample waits for later messages."""
    node = live(model_file=str(model_file), settle_time=1.0)
    now = feed(node, 20, start=5000.0)
    node.learner.payload_changed(now)
    feed(node, 20, start=now + after)
    assert len(node.arm.epoch) == 15


def test_messages_that_wait_are_answered_by_the_newest_alone(live, model_file):
    """All are learned from; a machine that is too slow is reported."""
    node = live(model_file=str(model_file), ramp_time=0.0, max_torque_rate=())
    now = feed(node, 20)
    assert status(node, 'input', now).level == OK
    node.arm.epoch.restart()
    t, q = motion(50, 2)
    read = node.read_all([slow_state(now + 0.2 + t[k], q[k], torque(q[k]))
                          for k in range(50)], 0.0)
    tau = node.arm.torque(now + 0.2, read[-1][1])
    np.testing.assert_allclose(tau, node.models.model.predict_one(q[-1]))
    for _, reading in read:
        node.arm.learn(reading, now + 0.2)
    # The last sample waits for later messages.
    assert len(node.arm.epoch) == 49
    report = status(node, 'input', now)
    assert report.level == WARN
    assert report.values['messages replaced by newer ones'] == '49'
    now = feed(node, 20, now + 20.0)
    assert status(node, 'input', now).level == OK


def test_a_gripper_that_publishes_first_does_not_become_the_arm(live):
    """Its message and those of the arm are read at once; it continues to publish."""
    node = live()
    t, q = motion(5)
    finger = slow_state(0.5, [0.1], [0.0], ['finger'])
    send_message(node, finger, 0.5)
    assert node.arm.joints == ('finger',) and node.arm.enable(False)[0]
    arm = [slow_state(1.0 + t[k], q[k], torque(q[k])) for k in range(4)]
    read = node.read_all([finger, *arm[:2], finger, *arm[2:]], 0.0)
    assert node.arm.joints == ('a', 'b') and not node.arm.feed.enabled
    assert [message for message, _ in read] == arm


def test_of_messages_without_stamps_that_wait_the_newest_is_answered(live):
    node = live(joints=('a', 'b'), max_age=0.3)
    for arrival in (10.0, 10.1):
        poses = [[0.1 * k, arrival] for k in range(3)]
        read = node.read_all([slow_state(0.0, q, [0.0, 0.0]) for q in poses], arrival)
        assert [reading.q.tolist() for _, reading in read] == poses


def test_torque_that_is_forbidden_stays_so_through_a_cleanup(model_file):
    """Also before the first message."""
    settings, kept = Parameters(max_age=0.0, unlimited_torque=True), Kept(False)
    for path in ('', str(model_file)):
        core = NodeCore(replace(settings, model_file=path), '/joint_states', 0.0, kept)
        for k in range(40):
            state = slow_state(1.0 + 0.1 * k, [1.2, 0.9], [0.0, 0.0])
            assert send_message(core, state, 0.1 * k)[1] is None
        core.close()
    assert not kept.is_allowed


def test_after_a_cleanup_torque_goes_on_from_that_published_last(model_file):
    """The controller has kept it: a first torque of zero would drop the arm."""
    settings, pose, sent = Parameters(model_file=str(model_file), max_age=0.0, max_torque=(
        50.0,)), np.array([1.2, 0.9]), {}
    kept = Kept()
    for _ in range(2):
        core, torques = NodeCore(settings, '/joint_states', 0.0, kept), []
        try:
            for k in range(400):
                state = slow_state(1.0 + 0.01 * k, pose, [0.0, 0.0])
                torques.append(send_message(core, state, 0.01 * k)[1])
        finally:
            core.close()
        np.testing.assert_allclose(torques[0], sent.get('a', 0.0) and torques[-1])
        sent = kept.torque
        assert sent['a'] > 4.0


@pytest.mark.parametrize('stamp, reason', [(1000.0, 'too_old'), (3000.0, 'from_future')])
def test_a_message_that_is_not_of_now_drives_no_torque(live, model_file, stamp, reason):
    node = live(model_file=str(model_file), ramp_time=0.0, max_torque_rate=(), max_age=0.3)
    for k in range(40):
        late = slow_state(stamp + 0.2 * k, [0.4, 0.1], [0.0, 0.0])
        assert send_message(node, late, 5.0 + 0.2 * k, 2000.0 + 0.2 * k) == (None, None)
    report = status(node, 'input', 5.0)
    assert report.level == ERROR and f'{reason} 40' in report.message
    assert '1e+03 s' in report.message and 'max_age' in report.message
    recent = slow_state(2007.9, [0.4, 0.1], [0.0, 0.0])
    assert send_message(node, recent, 13.0, 2008.0)[1] is not None


def test_a_refused_enable_starts_no_torque_when_limits_arrive(live, model_file):
    node = live(model_file=str(model_file), unlimited_torque=False, enabled=False)
    send_message(node, slow_state(1.0, [0.4, 0.1], [0.0, 0.0]), 1.0, 0.0)
    assert not node.arm.enable(True)[0]
    node.describe(URDF)
    assert not node.arm.feed.enabled
    assert node.arm.enable(True)[0] and node.arm.feed.enabled


def test_parameters_without_limits_do_not_end_the_torque(live, model_file):
    node = live(model_file=str(model_file), unlimited_torque=False, max_torque=(50.0,))
    none = replace(node.settings, max_torque=())
    node.arm.check(none)
    for k in range(200):
        send_message(node, slow_state(1.0 + 0.01 * k, [0.4, 0.1], [0.0, 0.0]), 0.01 * k)
    with pytest.raises(OptionError, match='fall to zero: call ~/enable'):
        node.arm.check(none)
    node.arm.check(replace(none, unlimited_torque=True))


def test_enabled_without_a_model_no_ramp_is_announced(live):
    node = live(joints=('a', 'b'))
    send_message(node, slow_state(1.0, [0.4, 0.1], [0.0, 0.0]), 1.0, 0.0)
    for enabled in (True, False):
        success, what = node.arm.enable(enabled)
        assert success and what.startswith('no model yet')


def test_the_limits_are_those_of_the_first_description(live, model_file):
    node = live(model_file=str(model_file), unlimited_torque=False, ramp_time=0.0,
                max_torque_rate=())
    assert send_message(node, slow_state(1.0, [0.4, 0.1], [0.0, 0.0]), 1.0, 0.0)[1] is None
    assert status(node, 'feed-forward').level == ERROR
    success, why = node.arm.enable(True)
    assert not success and 'max_torque' in why
    for effort in ('1.5', '40'):
        node.describe(URDF.replace('effort="1.5"', f'effort="{effort}"'))
        tau = send_message(node, slow_state(2.0 + float(effort), [0.4, 0.1], [0.0, 0.0]), 2.0,
                           0.0)[1]
        assert np.abs(tau).max() == 1.5
    assert status(node, 'feed-forward').values['torque limits'] == 'robot_description'
    assert node.events.log[-1][0] and 'not used' in node.events.log[-1][1]


def test_a_description_of_another_device_is_not_that_of_the_arm(live, model_file):
    """A gripper or a broken publisher comes first: the arm stayed without torque."""
    settings = {'unlimited_torque': False, 'ramp_time': 0.0}
    before, after = live(model_file=str(model_file), **settings), live(**settings)
    for node in (before, after):
        for text in ('', '<robot', '<robot name="x"><link name="finger"/></robot>', URDF, URDF):
            node.describe(text)
    send_message(after, slow_state(1.0, [0.4, 0.1], [0.0, 0.0]), 1.0)
    for node in (before, after):
        assert node.arm.limit_source == 'robot_description'
        assert node.arm.described.geometry is not None and 'axes used' in node.events.log[-1][1]


URDF = """<robot name="two"><link name="base"/><link name="one"/><link name="two"/>
<joint name="a" type="continuous"><parent link="base"/><child link="one"/>
<axis xyz="0 1 0"/><limit effort="1.5" velocity="1"/></joint>
<joint name="b" type="revolute"><parent link="one"/><child link="two"/>
<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>
<limit effort="1.5" velocity="1" lower="-2" upper="2"/></joint></robot>"""


def test_a_description_gives_axes_limits_and_continuous_joints():
    report = describe_arm(URDF, ('a', 'b'))
    assert report.geometry.joints == ('a', 'b') and report.continuous == ('a',)
    assert report.max_effort == (1.5, 1.5) and not report.problem
    assert 'no joint c' in describe_arm(URDF, ('a', 'c')).problem
    assert 'order' in describe_arm(URDF, ('b', 'a')).problem
    assert describe_arm('<robot', ('a',)).problem
    # A number beyond all drives is no limit.
    assert describe_arm(URDF.replace('effort="1.5"', 'effort="1e9"'), ('a', 'b')).max_effort == ()


@pytest.mark.parametrize('step', [1, -1])
def test_joints_in_alphabetical_order_cause_a_warning(live, step):
    names = ['elbow_joint', 'shoulder_lift_joint', 'shoulder_pan_joint']
    node = live()
    send_message(node, slow_state(1.0, [0.1, 0.2, 0.3], [0.0, 0.0, 0.0], names[::step]), 1.0)
    warnings = [text for is_warning, text in node.events.log if is_warning]
    assert len(warnings) == (step == 1) and all(', '.join(names[::-1]) in w for w in warnings)


def test_a_description_does_not_limit_torque_that_is_published_without_limits(live, model_file):
    node = live(model_file=str(model_file), ramp_time=0.0, max_torque_rate=())
    now = feed(node, 20)
    node.describe(URDF)
    pose = np.array([1.2, 0.9])
    tau = send_message(node, slow_state(now + 0.2, pose, [0.0, 0.0]), now + 0.2)[1]
    np.testing.assert_allclose(tau, node.models.model.predict_one(pose))
    assert tau[0] > 4.0 and node.arm.described.geometry is not None
    assert 'effort limits none' in node.events.log[-1][1]
