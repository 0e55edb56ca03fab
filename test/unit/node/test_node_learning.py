"""Fits, results and saves of `NodeCore` without ROS, with a real fit process."""

from dataclasses import replace
import os
import signal
from threading import Event
import time

from bench.shared.node_messages import (
    feed, joint_state, motion, refit, send_message, slow_state, status, torque, until)
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.model_file import load_model, save_model
from gravity_comp_ros.node import model_history
from gravity_comp_ros.node.checks import Check, DIAGNOSIS, FIT, FitResult
from gravity_comp_ros.node.diagnostics import ERROR, OK, WARN
from gravity_comp_ros.node.learner import Pending
import numpy as np
import pytest


def ask(node, is_diagnosis=False):
    """Request a fit or a diagnosis; return a list to which the reply is added."""
    replies = []
    node.learner.request(DIAGNOSIS if is_diagnosis else FIT, time.monotonic(),
                         lambda *reply: replies.append(reply))
    return replies


def saved(node, replies):
    """Save the model; add the reply to a list."""
    node.models.save(lambda *reply: replies.append(reply))


def test_the_result_of_a_fit_before_payload_changed_is_discarded(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False, settle_time=0.0)
    now = feed(node, 80)
    answers = ask(node)
    node.tick(time.monotonic())
    assert status(node, 'learning').values['fit process'] == 'fitting'
    assert node.learner.payload_changed(now)[0]
    before = node.models.model
    until(node, lambda: answers)
    assert not answers[0][0] and 'discarded' in answers[0][1]
    assert node.models.model is before


def test_close_replies_to_pending_calls(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False)
    feed(node, 80)
    answers = ask(node)
    node.close()
    assert answers == [(False, 'the node shuts down')]


def test_pauses_and_jumps_of_simulated_time_do_not_affect_fits(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False, fit_timeout=30.0)
    feed(node, 80)
    answers = ask(node)
    node.tick(20.0, time.monotonic())
    node.tick(1e6, time.monotonic())
    assert node.fits.job is not None and not answers
    end = time.monotonic() + 30.0
    while not answers:
        assert time.monotonic() < end
        node.tick(3.0, time.monotonic())
    assert answers[0][1].count('N·m') >= 2


def test_rollback_returns_to_the_previous_payload(live, model_file):
    node = live(model_file=str(model_file), auto_fit=False, settle_time=0.0)
    first = node.models.model
    # A refit before any change of the payload is a model of epoch 0.
    for epoch in (0, 1, 1, 1, 2, 2):
        node.models.use(replace(first), f'fit in epoch {epoch}', 0.0, epoch)
    assert len(node.models.past) == 3
    node.learner.payload_changed(0.5)
    assert 'epoch 1' in node.learner.roll_back(1.0)[1]
    assert 'epoch 0' in node.learner.roll_back(1.0)[1]
    assert 'loaded from' in node.learner.roll_back(2.0)[1]
    # A fit on request changes that model, not one that was rolled back.
    assert node.arm.epoch.base is node.models.model is first
    assert not node.learner.roll_back(3.0)[0]


@pytest.mark.parametrize('has_model', [False, True])
def test_the_last_fit_closes_an_epoch_unless_there_is_no_model_yet(live, model_file, has_model):
    """A first model that has not converged needs more motion, and its fit is repeated."""
    node = live(auto_fit=False, min_samples=10, full_samples=20)
    now, epoch = feed(node, 140), node.arm.epoch
    model = load_model(model_file)
    if has_model:
        node.models.use(model, 'earlier', now, 0)
    epoch.fit_started()
    check = Check('converged', 1.0, 0.5, text='not converged: keep moving slowly')
    node.learner._fit_ended(Pending(FIT, 0.0, epoch, None), FitResult(
        model, (check,), '', 'full fit', 0.0), now)
    assert epoch.is_open != has_model and 'keep moving' in node.learner.report
    feed(node, 60, now + 0.2)
    assert epoch.fit_is_due() != has_model


def test_another_count_of_revolutions_does_not_widen_the_trained_range(live, model_file):
    """As of a driver that has started again."""
    node = live(model_file=str(model_file), auto_fit=False, settle_time=0.0)
    before = node.models.model.coverage
    t, q = motion(140)
    for k in range(140):
        send_message(node, slow_state(1.0 + t[k], q[k] + [2.0 * np.pi, -2.0 * np.pi],
                                      torque(q[k])), 1.0 + t[k])
    assert refit(node)[0]
    assert before.distance(node.models.model.coverage.q_max).max() < 0.1


@pytest.mark.parametrize('number, timeout, is_diagnosis, reason', [
    (signal.SIGKILL, 60.0, False, 'died (signal 9'),
    (signal.SIGKILL, 60.0, True, 'died (signal 9'),
    (signal.SIGSTOP, 0.3, False, 'the fit hung')])
def test_a_lost_fit_process_is_reported_and_restarted(live, model_file, number, timeout,
                                                      is_diagnosis, reason):
    """A lost fit is a state of learning after the restart, a lost diagnosis is none."""
    node = live(model_file=str(model_file), auto_fit=False)
    feed(node, 80)
    refit(node)
    node.learner.payload_changed(0.0)
    feed(node, 80, 60.0)
    node.set(replace(node.settings, fit_timeout=timeout))
    before, pid = node.models.model, node.fits.pid
    # Stopped first, because on a busy machine the job might end before the signal.
    os.kill(pid, signal.SIGSTOP)
    answers = ask(node, is_diagnosis)
    os.kill(pid, number)
    until(node, lambda: answers)
    assert not answers[0][0] and reason in answers[0][1] and 'old model stays' in answers[0][1]
    assert any(answers[0][1] in text for _, text in node.events.log)
    learning = status(node, 'learning')
    assert learning.level == (OK if is_diagnosis else ERROR)
    assert is_diagnosis or reason in learning.message
    node.set(replace(node.settings, fit_timeout=60.0))
    assert refit(node)[1] and status(node, 'learning').level != ERROR
    assert node.fits.pid != pid and node.models.model.joints == before.joints


@pytest.mark.parametrize('corrupt, level, reply, report', [
    # Training samples with noise, held-out samples without.
    (lambda k, tau, rng: tau + (rng.normal(0.0, 1.0, 2) if (k // 5) % 4 != 3 else 0.0), WARN,
     'the old model stays in use', 'stays in use: '),
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
        send_message(node, slow_state(now + 1.0 + t[k], q[k], tau), now + 1.0 + t[k])
    success, text = refit(node)
    learning = status(node, 'learning')
    assert reply in text and report in learning.message and learning.level == level
    assert 'epoch 1 open' in learning.message
    assert not success and node.models.model is before
    assert any(is_warning and reply in line for is_warning, line in node.events.log)
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
        send_message(node, slow_state(1.0 + t, q, effort), t)


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
    node.models.use(second, 'another', 1.0, 0)
    saved(node, replies)
    both.set()
    until(node, lambda: len(replies) == 2)
    assert written == [first, second] and all(success for success, _ in replies)
    np.testing.assert_allclose(load_model(node.models.path).predict(q), second.predict(q))


def test_a_model_of_broken_effort_is_rolled_back_automatically(live, model_file, tmp_path):
    path = tmp_path / 'model.json'
    path.write_bytes(model_file.read_bytes())
    node = live(model_file=str(path), auto_fit=False, settle_time=0.0, auto_save=True)
    good, now = node.models.model, feed(node, 20)
    node.learner.payload_changed(now)
    t, q = motion(60)
    wrong = fit(JointSamples.single_run(['a', 'b'], t, q, 0 * q, torque(q, 1.8))).model
    node.models.use(wrong, 'fit of broken effort', now, 1)
    save_model(path, wrong)
    node.arm.use(wrong, good, 60)
    feed(node, 40, now + 1.0)
    node.tick(now + 10.0, time.monotonic())
    assert node.models.model is good
    # A restart must not bring the wrong model back.
    until(node, lambda: np.array_equal(load_model(path).predict(q), good.predict(q)))
    learning = status(node, 'learning')
    assert 'rolled back automatically' in learning.message and learning.level == ERROR
    assert any(line[0] for line in node.events.log)
    # After broken effort more samples are required.
    feed(node, 20, now + 30.0)
    assert 'needed after broken effort' in node.arm.epoch.missing_for_fit()
    node.learner.payload_changed(now + 50.0)
    feed(node, 20, now + 60.0)
    assert 'after broken effort' not in (node.arm.epoch.missing_for_fit() or '')


def test_of_an_arm_at_rest_one_sample_counts(live, model_file):
    """
    Friction holds any part of its torque.

    It neither trains a model nor confirms one, and no payload is suspected.
    """
    node = live(model_file=str(model_file), auto_fit=False, settle_time=0.0)
    rng = np.random.default_rng(0)
    node.learner.payload_changed(0.0)
    node.arm.use(node.models.model, node.models.model, 60)
    pose = np.array([0.4, 0.1])
    for k in range(600):
        noise = 1e-3 * rng.standard_normal((2, 2))
        state = joint_state('ab', 1.0 + 0.2 * k, pose + 0.1 * noise[0], noise[1],
                            torque(pose, 1.5))
        send_message(node, state, 1.0 + 0.2 * k)
    assert len(node.arm.epoch) == 1 and not node.arm.watch.is_confirmed
    assert not node.arm.watch.is_due()
    assert float(status(node, 'joint a').values['residual [Nm]']) > 0.5
    feed(node, 80, 200.0)
    assert len(node.arm.epoch) > 70 and node.arm.watch.is_confirmed


def test_another_payload_rolls_no_model_back(live, model_file):
    """A tool is put down before the model with it is confirmed."""
    node = live(model_file=str(model_file), auto_fit=False, settle_time=0.0)
    bare, now = node.models.model, feed(node, 20)
    node.learner.payload_changed(now)
    t, q = motion(60)
    loaded = fit(JointSamples.single_run(['a', 'b'], t, q, 0 * q, torque(q, 1.8))).model
    node.models.use(loaded, 'fit', now, 1)
    node.arm.use(loaded, bare, 60)
    now = feed(node, 5, now + 1.0, 1.8)
    node.learner.payload_changed(now)
    feed(node, 40, now + 1.0)
    node.tick(now + 10.0, time.monotonic())
    assert node.models.model is loaded and status(node, 'learning').level == OK
