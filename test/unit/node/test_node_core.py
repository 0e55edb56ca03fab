"""`NodeCore` without ROS, with explicit messages and time, and a real fit process."""

from dataclasses import replace
import os
import signal
from threading import Event
import time

from bench.shared.node_messages import joint_state as message, Nodes, refit, send_message, until
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.node import model_history
from gravity_comp_ros.node.arm import describe_arm
from gravity_comp_ros.node.diagnostics import ERROR, OK, STALE, WARN
from gravity_comp_ros.node.learner import DIAGNOSIS, FIT
from gravity_comp_ros.node.torque_source import UncertainChange
import numpy as np
import pytest


def torque(q, mass=1.0):
    return mass * np.array([5.0, 2.0]) * np.sin(q)


def motion(n, seed=0):
    """Return time (n,) and poses (n, 2) of slow motion."""
    t = 0.2 * np.arange(n)
    return t, np.stack([1.2 * np.sin(0.11 * t + seed), 0.9 * np.cos(0.07 * t + seed)], axis=1)


def joint_state(t, q, tau, names=('a', 'b')):
    return message(names, t, q, [0.14] * len(q), tau)


@pytest.fixture(scope='module')
def nodes():
    nodes = Nodes()
    yield nodes
    nodes.end()


@pytest.fixture
def live(nodes):
    def make(**settings):
        return nodes.make(**{'unlimited_torque': True, 'max_age': 0.0, **settings})

    yield make
    nodes.close()


@pytest.fixture(scope='module')
def model_file(tmp_path_factory):
    t, q = motion(300)
    rng = np.random.default_rng(0)
    tau = torque(q) + 0.01 * rng.standard_normal(q.shape)
    path = tmp_path_factory.mktemp('live') / 'model.json'
    # Joints that do not load each other are no chain.
    save_model(path, fit(JointSamples.single_run(['a', 'b'], t, q, 0 * q, tau),
                         FitOptions(formulation='potential')).model)
    return path


def feed(node, n, start=1.0, mass=1.0, seed=0):
    t, q = motion(n, seed)
    tau = torque(q, mass) + 0.01 * np.random.default_rng(7).standard_normal(q.shape)
    for k in range(n):
        send_message(node, joint_state(start + t[k], q[k], tau[k]), start + t[k], 0.0)
    return start + t[-1]


def ask(node, is_diagnosis=False):
    """Request a fit or a diagnosis; return a list to which the reply is added."""
    replies = []
    node.learner.request(DIAGNOSIS if is_diagnosis else FIT, time.monotonic(),
                         lambda *reply: replies.append(reply))
    return replies


def saved(node, replies):
    """Save the model; add the reply to a list."""
    node.models.save(lambda *reply: replies.append(reply))


def status(node, name, now=0.0):
    return {each.name: each for each in node.statuses(now)}[name]


def test_it_learns_the_torque_and_publishes_it(live):
    node = live(ramp_time=0.0, max_torque_rate=())
    now = feed(node, 140)
    until(node, lambda: node.models.model is not None)
    last = joint_state(now + 0.2, [0.4, 0.1], [0.0, 0.0])
    reading, tau = send_message(node, last, now + 0.2, 0.0)
    np.testing.assert_allclose(tau, torque(np.array([0.4, 0.1])), atol=0.05)


@pytest.mark.parametrize('content', [b'', b'null', b'\x00\xff' * 99,
                                     b'{"format": "gravity_comp_ros model", "version": 99}'])
def test_files_that_are_no_model_are_reported_and_not_changed(live, content, tmp_path):
    path = tmp_path / 'model.json'
    path.write_bytes(content)
    node = live(model_file=str(path))
    assert status(node, 'model').level == ERROR
    assert send_message(node, joint_state(1.0, [0.1, 0.2], [0.0, 0.0]), 1.0, 0.0)[1] is None
    answers = []
    saved(node, answers)
    assert not answers[0][0] and path.read_bytes() == content
    # The first message does not end the report.
    assert status(node, 'model').level == ERROR and 'model.json' in status(node, 'model').message


def test_a_model_of_other_joints_is_not_used(live, model_file):
    node = live(model_file=str(model_file), joints=('b', 'a'))
    assert node.models.model is None and status(node, 'model').level == ERROR


def test_the_result_of_a_fit_before_payload_changed_is_discarded(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False, settle_time=0.0)
    now = feed(node, 80)
    until(node, lambda: node.fits.state == 'ready')
    answers = ask(node)
    node.tick(time.monotonic())
    assert node.fits.state == 'fitting'
    assert node.learner.payload_changed(now)[0]
    before = node.models.model
    until(node, lambda: answers)
    assert not answers[0][0] and 'discarded' in answers[0][1]
    assert node.models.model is before


def test_payload_changed_in_an_empty_epoch_drops_the_sample_that_waits(live, model_file):
    node = live(model_file=str(model_file), settle_time=0.1)
    t, q = motion(24)
    for k in range(24):
        if k == 20:
            node.learner.payload_changed(t[k] - 0.15)
        if k == 21:
            assert 'open already' in node.learner.payload_changed(t[k] - 0.15)[1]
            assert node.arm.epoch.number == 1 and len(node.arm.epoch) == 0
        send_message(node, joint_state(1.0 + t[k], q[k], torque(q[k])), t[k])
    # The last of three samples waits for later messages; the one before the call is gone.
    assert len(node.arm.epoch) == 2


def test_a_first_message_that_names_no_arm(live):
    node = live()
    names = [f'j{k}' for k in range(11)]
    large = joint_state(1.0, [0.0] * 11, [0.0] * 11, names)
    assert send_message(node, large, 1.0, 0.0) == (None, None)
    assert 'set the parameter joints' in status(node, 'model').message
    assert send_message(node, joint_state(2.0, [0.1, 0.2], [0.0, 0.0]), 2.0, 0.0)[0] is not None
    assert node.arm.joints == ('a', 'b') and status(node, 'model').level == WARN


def test_levels_of_the_input(live):
    node = live(joints=('a', 'b'))
    assert status(node, 'input').level == STALE
    send_message(node, joint_state(1.0, [0.1], [0.1], ['a']), 1.0, 0.0)
    assert status(node, 'input', 1.0).level == ERROR
    send_message(node, joint_state(1.1, [0.1, 0.2], [0.1, 0.2]), 1.1, 0.0)
    assert status(node, 'input', 1.1).level == OK
    send_message(node, joint_state(1.2, [0.1, 0.2], [0.1, float('nan')]), 1.2, 0.0)
    report = status(node, 'input', 1.2)
    assert report.level == WARN and 'effort_not_finite 1' in report.message
    assert status(node, 'input', 9.0).level == STALE


def test_a_large_residual_suggests_another_payload(live, model_file):
    node = live(model_file=str(model_file))
    now = feed(node, 40)
    quiet = status(node, 'joint a', now)
    assert quiet.level == OK and float(quiet.values['residual beside friction [Nm]']) < 0.02
    feed(node, 40, now + 0.2, mass=1.5)
    loud = status(node, 'joint a', now + 8.0)
    assert loud.level == WARN and 'another payload' in loud.message


def test_close_replies_to_pending_calls(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False)
    feed(node, 80)
    answers = ask(node)
    node.close()
    assert answers == [(False, 'the node shuts down')]


@pytest.mark.parametrize('after', [0.2, -4990.0])
def test_nothing_is_learned_during_the_settle_time(live, model_file, after):
    """Also with a clock that is set back meanwhile; the last sample waits for later messages."""
    node = live(model_file=str(model_file), settle_time=1.0)
    now = feed(node, 20, start=5000.0)
    node.learner.payload_changed(now)
    feed(node, 20, start=now + after)
    assert len(node.arm.epoch) == 15


def test_pauses_and_jumps_of_simulated_time_do_not_affect_fits(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False, fit_timeout=30.0)
    feed(node, 80)
    until(node, lambda: node.fits.state == 'ready')
    answers = ask(node)
    node.tick(20.0, time.monotonic())
    node.tick(1e6, time.monotonic())
    assert node.fits.state == 'fitting' and not answers
    end = time.monotonic() + 30.0
    while not answers:
        assert time.monotonic() < end
        node.tick(3.0, time.monotonic())
    assert answers[0][1].count('N·m') >= 2


def test_messages_that_wait_are_answered_by_the_newest_alone(live, model_file):
    """All are learned from; a machine that is too slow is reported."""
    node = live(model_file=str(model_file), ramp_time=0.0, max_torque_rate=())
    now = feed(node, 20)
    assert status(node, 'input', now).level == OK
    node.arm.epoch.restart()
    t, q = motion(50, 2)
    read = node.read_all([joint_state(now + 0.2 + t[k], q[k], torque(q[k]))
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
    finger = joint_state(0.5, [0.1], [0.0], ['finger'])
    send_message(node, finger, 0.5)
    assert node.arm.joints == ('finger',) and node.arm.enable(False)[0]
    arm = [joint_state(1.0 + t[k], q[k], torque(q[k])) for k in range(4)]
    read = node.read_all([finger, *arm[:2], finger, *arm[2:]], 0.0)
    assert node.arm.joints == ('a', 'b') and not node.arm.feed.enabled
    assert [message for message, _ in read] == arm


def test_of_messages_without_stamps_that_wait_the_newest_is_answered(live):
    node = live(joints=('a', 'b'), max_age=0.3)
    for arrival in (10.0, 10.1):
        poses = [[0.1 * k, arrival] for k in range(3)]
        read = node.read_all([joint_state(0.0, q, [0.0, 0.0]) for q in poses], arrival)
        assert [reading.q.tolist() for _, reading in read] == poses


@pytest.mark.parametrize('stamp, reason', [(1000.0, 'too_old'), (3000.0, 'from_future')])
def test_a_message_that_is_not_of_now_drives_no_torque(live, model_file, stamp, reason):
    node = live(model_file=str(model_file), ramp_time=0.0, max_torque_rate=(), max_age=0.3)
    for k in range(40):
        late = joint_state(stamp + 0.2 * k, [0.4, 0.1], [0.0, 0.0])
        assert send_message(node, late, 5.0 + 0.2 * k, 2000.0 + 0.2 * k) == (None, None)
    report = status(node, 'input', 5.0)
    assert report.level == ERROR and f'{reason} 40' in report.message
    assert '1e+03 s' in report.message and 'max_age' in report.message
    recent = joint_state(2007.9, [0.4, 0.1], [0.0, 0.0])
    assert send_message(node, recent, 13.0, 2008.0)[1] is not None


def test_a_queued_refit_is_answered_after_payload_changed(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False)
    now = feed(node, 80)
    until(node, lambda: node.fits.state == 'ready')
    answers = ask(node)
    assert node.learner.payload_changed(now)[0] and not answers
    node.tick(time.monotonic())
    assert answers == [(False, 'no slow samples yet: move the arm slowly through its range')]
    assert node.fits.state == 'ready' and status(node, 'learning').level == OK


def test_the_limits_are_those_of_the_first_description(live, model_file):
    node = live(model_file=str(model_file), unlimited_torque=False, ramp_time=0.0,
                max_torque_rate=())
    assert send_message(node, joint_state(1.0, [0.4, 0.1], [0.0, 0.0]), 1.0, 0.0)[1] is None
    assert status(node, 'feed-forward').level == ERROR
    success, why = node.arm.enable(True)
    assert not success and 'max_torque' in why
    for effort in ('1.5', '40'):
        node.describe(URDF.replace('effort="1.5"', f'effort="{effort}"'))
        tau = send_message(node, joint_state(2.0 + float(effort), [0.4, 0.1], [0.0, 0.0]), 2.0,
                           0.0)[1]
        assert np.abs(tau).max() == 1.5
    assert status(node, 'feed-forward').values['torque limits'] == 'robot_description'
    assert node.events.log[-1][0] and 'not used' in node.events.log[-1][1]


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
    send_message(node, joint_state(1.0, [0.1, 0.2, 0.3], [0.0, 0.0, 0.0], names[::step]), 1.0)
    warnings = [text for is_warning, text in node.events.log if is_warning]
    assert len(warnings) == (step == 1) and all(', '.join(names[::-1]) in w for w in warnings)


def test_rollback_returns_to_the_previous_payload(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False, settle_time=0.0)
    first = node.models.model
    for epoch in (1, 1, 1, 2, 2):
        node.models.use(first, f'fit in epoch {epoch}', 0.0, epoch)
    assert node.models.n_past == 2
    assert 'epoch 1' in node.learner.roll_back(1.0)[1]
    assert 'loaded from' in node.learner.roll_back(2.0)[1]
    assert not node.learner.roll_back(3.0)[0]


@pytest.mark.parametrize('number, timeout, is_diagnosis, reason', [
    (signal.SIGKILL, 60.0, False, 'died (signal 9)'), (signal.SIGSTOP, 0.3, False, 'the fit hung'),
    (signal.SIGKILL, 60.0, True, 'died (signal 9)')])
def test_a_lost_fit_process_is_reported_and_restarted(live, model_file, number, timeout,
                                                      is_diagnosis, reason):
    """A lost fit is a state of learning after the restart, a lost diagnosis is none."""
    node = live(model_file=str(model_file), auto_fit=False, fit_timeout=timeout)
    feed(node, 80)
    before = node.models.model
    until(node, lambda: node.fits.state == 'ready')
    pid = node.fits.pid
    # Stopped first, because on a busy machine the job might end before the signal.
    os.kill(pid, signal.SIGSTOP)
    answers = ask(node, is_diagnosis)
    until(node, lambda: node.fits.state == 'fitting')
    os.kill(pid, number)
    until(node, lambda: answers)
    assert not answers[0][0] and reason in answers[0][1] and 'old model stays' in answers[0][1]
    assert any(answers[0][1] in text for _, text in node.events.log)
    assert status(node, 'learning').level == ERROR and reason in status(node, 'learning').message
    node.set(replace(node.settings, fit_timeout=60.0))
    until(node, lambda: node.fits.state == 'ready')
    assert status(node, 'learning').level == (OK if is_diagnosis else ERROR)
    assert node.fits.pid != pid and node.models.model is before
    assert refit(node)[1] and status(node, 'learning').level != ERROR


@pytest.mark.parametrize('corrupt, level, reply, report', [
    # Training samples with noise, held-out samples without.
    (lambda k, tau, rng: tau + (rng.normal(0.0, 1.0, 2) if (k // 5) % 4 != 3 else 0.0), WARN,
     'the old model stays in use', 'old model kept: '),
    (lambda k, tau, rng: -tau, ERROR, 'unit or sign', 'broken effort: '),
    (lambda k, tau, rng: 0.01 * rng.standard_normal(2), ERROR, 'drives off', 'broken effort: ')],
    ids=['worse', 'sign', 'no effort'])
def test_the_learning_status_names_the_result_of_a_fit(live, model_file, corrupt, level, reply,
                                                       report):
    node = live(model_file=str(model_file), auto_fit=False, settle_time=0.0)
    before, now, rng = node.models.model, feed(node, 20), np.random.default_rng(1)
    node.learner.payload_changed(now)
    t, q = motion(121)
    for k in range(121):
        tau = corrupt(k, torque(q[k]), rng) + 0.01 * rng.standard_normal(2)
        send_message(node, joint_state(now + 1.0 + t[k], q[k], tau), now + 1.0 + t[k])
    success, text = refit(node)
    learning = status(node, 'learning')
    assert reply in text and report in learning.message and learning.level == level
    assert 'epoch 1 open' in learning.message
    assert not success and node.models.model is before
    assert any(value.startswith('not ') for value in learning.values.values())
    # A new payload begins without the result of the earlier one.
    node.learner.payload_changed(now + 50.0)
    assert status(node, 'learning').level == OK


def test_a_save_that_fails_is_answered_and_the_next_one_succeeds(live, model_file, tmp_path,
                                                                monkeypatch):
    assert 'no file' not in status(live(model_file='~unknown_user_name/m.json'), 'model').message
    node, replies, save = live(model_file=str(model_file)), [], model_history.save_model
    text = node.events.log.popleft()[1]
    assert 'a, b' in text and 'loaded from' in text and 'torque limits' in text
    node.models.path = str(tmp_path / 'none' / 'model.json')

    def full_memory(path, model):
        monkeypatch.setattr(model_history, 'save_model', save)
        raise MemoryError('no memory')

    monkeypatch.setattr(model_history, 'save_model', full_memory)
    for reason, level in (('no memory', WARN), ('none', WARN), ('saved', OK)):
        saved(node, replies)
        until(node, lambda: replies)
        success, text = replies.pop()
        assert success == (level == OK) and reason in text
        # The status is that of the last save.
        assert status(node, 'model').level == level
        if reason == 'none':
            (tmp_path / 'none').mkdir()


def feed_efforts(node, tau):
    """Send slow motion with these efforts (M, 2)."""
    for t, q, effort in zip(*motion(len(tau)), tau):
        send_message(node, joint_state(1.0 + t, q, effort), t)


def test_samples_that_were_left_out_as_outliers_are_a_warning(live):
    """A transient of the controller on a joint without gravity, in a first model."""
    node, rng = live(auto_fit=False, formulation='chain'), np.random.default_rng(2)
    tau = torque(motion(200)[1]) * [1.0, 0.0] + 0.01 * rng.standard_normal((200, 2))
    tau[100:103, 1] += [9.0, -9.0, 7.0]
    feed_efforts(node, tau)
    success, text = refit(node)
    report = status(node, 'learning')
    assert success and report.level == WARN and 'outliers: 3 of b (' in report.message
    assert 'brake' in report.message and 'epoch 0 open' in report.message


@pytest.mark.parametrize('tau, level, reason', [
    (0.01 * torque(motion(200)[1]), ERROR, 'accept: [effort_unit]'),
    (0.1 * np.random.default_rng(2).standard_normal((200, 2)), WARN, 'compensate gravity itself')],
    ids=['another unit', 'no gravity'])
def test_what_fit_refuses_gives_no_first_model_unless_it_is_accepted(live, tau, level, reason):
    node = live(auto_fit=False, formulation='potential')
    feed_efforts(node, tau)
    success, text = refit(node)
    assert not success and node.models.model is None and reason in text
    report = status(node, 'learning')
    assert report.level == level and reason in report.message
    if level == ERROR:
        node = live(auto_fit=False, formulation='potential', accept=('effort_unit',))
        feed_efforts(node, tau)
        assert refit(node)[0] and node.models.model is not None


def test_the_file_has_the_model_of_the_last_save(live, model_file, tmp_path, monkeypatch):
    """The first save takes longer than the second."""
    node = live(model_file=str(model_file))
    node.models.path = str(tmp_path / 'model.json')
    first = node.models.model
    t, q = motion(60)
    second = fit(JointSamples.single_run(['a', 'b'], t, q, 0 * q, torque(q, 1.8))).model
    save, written, both = model_history.save_model, [], Event()

    def slow_disk(path, model):
        # A save that blocks its caller would end here.
        assert model is not first or both.wait(60.0)
        save(path, model)
        written.append(model)

    monkeypatch.setattr(model_history, 'save_model', slow_disk)
    replies = []
    saved(node, replies)
    node.models.use(second, 'another', 1.0)
    saved(node, replies)
    both.set()
    until(node, lambda: len(replies) == 2)
    assert written == [first, second] and all(success for success, _ in replies)
    np.testing.assert_allclose(load_model(node.models.path).predict(q), second.predict(q))


def test_a_description_does_not_limit_torque_that_is_published_without_limits(live, model_file):
    node = live(model_file=str(model_file), ramp_time=0.0, max_torque_rate=())
    now = feed(node, 20)
    node.describe(URDF)
    pose = np.array([1.2, 0.9])
    tau = send_message(node, joint_state(now + 0.2, pose, [0.0, 0.0]), now + 0.2)[1]
    np.testing.assert_allclose(tau, node.models.model.predict_one(pose))
    assert tau[0] > 4.0 and node.arm.geometry is not None
    assert 'effort limits none' in node.events.log[-1][1]


def test_an_uncertain_change_without_a_standard_deviation_is_not_used(live, model_file):
    node = live(model_file=str(model_file), ramp_time=0.0, max_torque_rate=())
    now = feed(node, 20)
    base = node.models.model
    t, q = motion(60)
    samples = JointSamples.single_run(['a', 'b'], t, q, 0 * q, torque(q, 1.8))
    unknown = replace(fit(samples).model, uncertainty=None)
    change = UncertainChange(unknown, base, q.min(axis=0), q.max(axis=0))
    node.arm.use(unknown, base, 60, change)
    pose = np.array([0.4, 0.1])
    tau = send_message(node, joint_state(now + 0.2, pose, [0.0, 0.0]), now + 0.2)[1]
    np.testing.assert_allclose(tau, base.predict_one(pose))


def test_a_model_of_broken_effort_is_rolled_back_automatically(live, model_file, tmp_path):
    path = tmp_path / 'model.json'
    path.write_bytes(model_file.read_bytes())
    node = live(model_file=str(path), auto_fit=False, settle_time=0.0, auto_save=True)
    good, now = node.models.model, feed(node, 20)
    node.learner.payload_changed(now)
    t, q = motion(60)
    wrong = fit(JointSamples.single_run(['a', 'b'], t, q, 0 * q, torque(q, 1.8))).model
    entry = node.models.use(wrong, 'fit of broken effort', now, 1)
    save_model(path, wrong)
    node.arm.use(entry.model, good, 60)
    feed(node, 40, now + 1.0)
    node.tick(now + 10.0, time.monotonic())
    assert node.models.model is good
    # A restart must not bring the wrong model back.
    until(node, lambda: np.array_equal(load_model(path).predict(q), good.predict(q)))
    assert 'rolled back automatically' in node.arm.epoch.describe()
    assert any(line[0] for line in node.events.log) and status(node, 'learning').level == ERROR
    # After broken effort more samples are required.
    feed(node, 20, now + 30.0)
    assert 'needed after broken effort' in node.arm.epoch.missing_for_fit()
    node.learner.payload_changed(now + 50.0)
    assert not node.arm.epoch.had_broken_effort
