"""Node as a separate process over DDS: learning, publishing, services, shutdown."""

from dataclasses import replace
from pathlib import Path
import signal
import subprocess
import sys
import time

from bench.shared.ros_harness import matrix, ROOT, running, set_parameter
from gravity_comp_ros.commands import replay
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.bag import read_bag
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock

pytestmark = pytest.mark.slow

BAGS = ROOT / 'bags'
UNLIMITED = {'ramp_time': 0.0, 'max_torque_rate': '[]', 'extrapolation': 'trust'}
# Stamp offset after all training samples, s.
LATER = 50000.0
PATIENT = {'stale_after': 10.0, 'unlimited_torque': True}


@pytest.fixture(scope='module')
def bags():
    return {path.stem: read_bag(path).samples for path in BAGS.glob('eq17*.mcap')}


def part(samples, start, stop):
    return samples.select(np.arange(start, stop))


def answers(messages):
    """Return the messages with the stamp of a recording, not of the present time."""
    return [message for message in messages if message.header.stamp.sec < 1e6]


def until_last(probe, samples, messages=None):
    """Wait for the answer to the last of these samples; earlier ones may have none."""
    last, sent = round(float(samples.t[-1]), 6), time.monotonic()
    messages = probe.torques if messages is None else messages

    def answered():
        nonlocal sent
        if any(round(stamp(m), 6) == last for m in messages):
            return True
        if time.monotonic() - sent > 5.0:
            # Messages are lost while a new subscription is discovered on a busy machine.
            probe.stream(part(samples, len(samples) - 1, len(samples)))
            sent = time.monotonic()
        return False

    probe.until(answered, 60, 'the last answer')


def stamp(message):
    """Return the stamp of a message in s."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def published(samples, messages, offset=0.0):
    """Return the rows of samples with the stamps of messages, and the efforts of these."""
    stamps = {round(t + offset, 6): k for k, t in enumerate(samples.t)}
    rows = [stamps[round(stamp(m), 6)] for m in messages]
    return rows, matrix(messages)


def learn_all(probe, samples):
    """Send samples until the node has all of them and its fits have ended."""
    probe.stream(samples)
    count, start = len(samples), 0.0

    def learned():
        nonlocal start
        probe.report('learning')
        values = probe.values('learning')
        missing = count - int(values['samples'])
        if missing > 0:
            # On a busy machine some messages are lost.
            start += 200.0
            probe.stream(part(samples, 0, missing), start)
        return missing <= 0 and values['fit process'] == 'ready'

    # The fits have the lowest priority, and the tests run in parallel.
    probe.until(learned, 300, 'the fits')


def test_node_and_commands_give_the_same_torques(bags, tmp_path):
    path = tmp_path / 'learned.json'
    with running({**UNLIMITED, **PATIENT, 'model_file': path}) as (_, probe):
        assert 'no model' in probe.report('model').message and not probe.torques
        answer = probe.call('refit')
        assert not answer.success and 'no joint states yet' in answer.message
        learn_all(probe, bags['eq17_unloaded'])
        saved = probe.call('save_model')
        assert saved.success and str(path) in saved.message
        probe.torques.clear(), probe.predictions.clear(), probe.residuals.clear()
        probe.commands.clear()
        later = bags['eq17_later']
        probe.stream(later, start=LATER)
        # During fits longer than `stale_after` torque is published without input. On a busy
        # machine joint states may be lost, because the input is best effort.
        probe.until(lambda: len(answers(probe.torques)) == len(probe.predictions)
                    == len(probe.residuals) > 20
                    and len(probe.torques) == len(probe.commands), 60, 'torque for every message')
    model = load_model(path)
    rows, torques = published(later, answers(probe.torques), LATER)
    # A chain and its expansion, which the node evaluates, differ by the weights that it omits.
    np.testing.assert_allclose(torques, model.predict(later.q[rows]), rtol=0, atol=1e-4)
    commands = [list(m.data) for m in probe.commands][-len(rows):]
    np.testing.assert_array_equal(torques, commands)
    rows, predictions = published(later, probe.predictions, LATER)
    assert replay_command(path, tmp_path)[rows] == pytest.approx(predictions, abs=1e-4)
    rows, residuals = published(later, probe.residuals, LATER)
    np.testing.assert_allclose(residuals, later.tau[rows] - model.predict(later.q[rows]),
                               rtol=0, atol=1e-4)
    # 0.1 N·m of it is noise; the rest includes inertia, which the model does not include.
    assert np.sqrt(np.mean(residuals ** 2, axis=0)).max() < 0.2
    assert list(probe.torques[0].name) == list(later.names)


def replay_command(model: Path, folder: Path) -> np.ndarray:
    """Return the prediction of `gravity_comp replay` for the same bag."""
    out = folder / 'out.mcap'
    done = subprocess.run(
        [sys.executable, '-m', 'gravity_comp_ros.cli', 'replay', BAGS / 'eq17_later.mcap',
         '--model', model, '-o', out], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    from gravity_comp_ros.recordings.bag import ReadOptions
    return read_bag(out, ReadOptions(topic=replay.PREDICTION)).samples.tau


def test_a_changed_payload_is_learned_in_seconds_and_rolled_back(bags, iiwa_model_file):
    loaded = bags['eq17_2kg']
    with running({**UNLIMITED, **PATIENT, 'model_file': iiwa_model_file}) as (_, probe):
        probe.stream(part(loaded, 0, 20))
        until_last(probe, part(loaded, 0, 20), probe.residuals)
        _, stale = published(loaded, probe.residuals)
        answer = probe.call('payload_changed')
        assert answer.success and 'epoch 1 open' in answer.message
        again = probe.call('payload_changed')
        assert again.success and 'open already' in again.message
        probe.spin(0.6)
        probe.stream(part(loaded, 20, 170), period=0.01)
        probe.until(lambda: 'change of the old model' in probe.status['model'].message, 60)
        first, second = probe.call_async('refit'), probe.call_async('refit')
        probe.until(lambda: first.done() and second.done(), 60)
        texts = sorted(f.result().message for f in (first, second))
        assert any('is running already' in text for text in texts), texts
        probe.residuals.clear()
        probe.stream(part(loaded, 170, 220))
        until_last(probe, part(loaded, 170, 220), probe.residuals)
        _, relearned = published(loaded, probe.residuals)
        back, torques, stamps, slower = rolled_back_at_rest(probe, loaded)
        assert back.success and 'back to the' in back.message
        assert probe.report('learning') and 'closed' in probe.values('learning')['epoch']
        for _ in range(12):
            last = probe.call('rollback')
        assert not last.success and 'no model of an earlier payload' in last.message
    # A swap of models makes small steps at 250 Hz or the rate that was reached.
    assert np.abs(torques[-1] - torques[0]).max() > 5.0
    steps, gaps = np.abs(np.diff(torques, axis=0)).max(axis=1), np.diff(stamps)
    moving = (steps > 0.0) & (gaps < 0.2)
    # Only the newest of waiting messages is answered: 12.5 N·m/s.
    assert moving.sum() > 10 and np.median(steps[moving] / gaps[moving]) <= 0.05 / 0.004 * slower
    # Messages may be late or in pairs; over 0.1 s this averages out.
    change = np.abs(torques[25:] - torques[:-25]).max(axis=1)
    assert (change <= 1.25 * 0.05 * slower * (stamps[25:] - stamps[:-25]) / 0.004).all()
    worst = np.sqrt(np.mean(stale ** 2, axis=0)).max()
    assert worst > 2.0
    assert np.sqrt(np.mean(relearned ** 2, axis=0)).max() < 0.25 * worst


def rolled_back_at_rest(probe, samples):
    """
    Call rollback with the arm at rest; return the reply, the torques and their stamps.

    The last result is the factor by which messages were slower than 250 Hz.
    """
    assert set_parameter(probe, 'ramp_time', 1.0).successful
    probe.torques.clear()
    begun = due = time.monotonic()
    for k in range(5000):
        if k == 100:
            rollback = probe.call_async('rollback')
        probe.send(samples.names, samples.t[-1] + 1.0 + 0.004 * k, samples.q[250],
                   0.0 * samples.qd[250])
        due += 0.004
        probe.spin(max(1e-4, due - time.monotonic()))
        # On a busy machine messages are late, and the swap takes longer.
        if k > 500 and np.abs(np.subtract(probe.torques[-1].effort,
                                          probe.torques[0].effort)).max() > 5.0:
            break
    slower = max(1.0, (time.monotonic() - begun) / (k + 1) / 0.004)
    probe.until(rollback.done)
    replies = answers(probe.torques)
    torques = matrix(replies)
    stamps = np.array([stamp(m) for m in replies])
    return rollback.result(), torques, stamps, slower


def test_a_worse_model_is_not_accepted(bags, iiwa_model_file):
    good = bags['eq17_unloaded']
    rng = np.random.default_rng(1)
    with running({**UNLIMITED, **PATIENT, 'model_file': iiwa_model_file}) as (_, probe):
        for k in range(80):
            # Training samples with 3 N·m of noise, held-out samples without.
            tau = good.tau[k] + (rng.normal(0, 3.0, 7) if (k // 5) % 4 != 3 else 0.0)
            probe.send(good.names, good.t[k], good.q[k], good.qd[k], tau)
            probe.spin(0.004)
        before = probe.report('model').message
        answer = probe.call('refit')
        assert not answer.success and 'the old model stays' in answer.message
        assert answer.message.count('N·m') >= 2
        assert probe.report('model').message == before
        assert 'old model kept' in probe.status['learning'].message


def test_a_dead_fit_process_is_restarted_and_the_model_stays(bags, iiwa_model_file):
    import os
    good = bags['eq17_later']
    with running({**PATIENT, 'model_file': iiwa_model_file, 'max_torque': '[200.0]',
                  'auto_fit': False}) as (_, probe):
        probe.stream(part(good, 0, 200))
        probe.report('learning')
        probe.until(lambda: probe.values('learning')['fit process'] == 'ready', 60)
        pid = int(probe.values('learning')['fit process id'])
        os.kill(pid, signal.SIGSTOP)
        waiting = probe.call_async('refit')
        probe.until(lambda: probe.report('learning')
                    and probe.values('learning')['fit process'] == 'fitting', 60)
        os.kill(pid, signal.SIGKILL)
        probe.until(waiting.done, 60, 'the answer about the dead process')
        assert not waiting.result().success
        assert 'the fit process died (signal 9); the old model stays' in \
            waiting.result().message
        status = probe.report('learning')
        assert status.level == b'\x02' and 'died' in status.message
        probe.until(lambda: probe.report('learning')
                    and probe.values('learning')['fit process'] == 'ready', 60)
        assert int(probe.values('learning')['fit process id']) != pid
        assert probe.call('refit').message
        assert probe.report('learning').level != b'\x02'


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_cleanly_without_delay(number, iiwa_model_file, bags):
    """Shutdown is shorter than startup under the same load: it waits for no thread."""
    is_shorter = []
    # Three tries, because the load may change.
    while len(is_shorter) < 3 and not any(is_shorter):
        begin = time.monotonic()
        with running({'model_file': iiwa_model_file}) as (node, probe):
            ready = time.monotonic()
            probe.stream(part(bags['eq17_later'], 0, 30))
            stop = time.monotonic()
            code, output = node.stop(number, timeout=60)
            is_shorter.append(time.monotonic() - stop < ready - begin)
        assert code == 0 and 'Traceback' not in output, output
    assert any(is_shorter)


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_signals_during_startup_end_it_without_a_traceback(number, iiwa_model_file):
    for after in (0.3, 0.8, 1.3, 1.6):
        with running({'model_file': iiwa_model_file}, wait=False) as (node, probe):
            probe.spin(after)
            code, output = node.stop(number, timeout=60)
        # Before Python handles signals, the default action ends the process.
        assert code in (0, -number), output
        assert 'Traceback' not in output or 'gravity_comp_ros' not in output, output


def test_bad_parameters_are_refused_with_the_reason(iiwa_model_file):
    with running({'model_file': iiwa_model_file}) as (_, probe):
        for name, value, why in [
                ('max_speed', -1.0, '0.001'), ('max_speed', 'fast', 'parameter type'),
                ('formulation', 'magic', 'one of auto, potential, chain'),
                ('max_torque', [1.0, 2.0], '2 values for 7 joints'),
                ('max_torque', [float('nan')], 'finite'), ('joints', ['a'], 'read-only'),
                ('full_samples', 5000, 'more than capacity'),
                ('effects', ['coulomb_friction'], '')]:
            result = set_parameter(probe, name, value)
            if name == 'effects' and result.successful:
                continue
            assert not result.successful and why in result.reason, (name, result)
        assert set_parameter(probe, 'max_torque', [100.0]).successful
        assert set_parameter(probe, 'max_speed', 1.0).successful
        assert set_parameter(probe, 'compensate', ['coulomb_friction']).successful


@pytest.mark.parametrize('parameters, why', [
    ({'max_speed': -3.0}, 'max_speed'), ({'formulation': 'magic'}, 'one of auto, potential'),
    ({'joints': '[a,b]', 'max_torque': '[1.0,2.0,3.0]'}, '3 values for 2 joints')])
def test_bad_parameters_at_the_start_end_it_with_one_line(parameters, why):
    with running(parameters, wait=False) as (node, _):
        code, output = node.wait(60)
    assert code == 1 and why in output and 'Traceback' not in output, output
    assert len(output.strip().splitlines()) == 1


def test_a_damaged_model_file_is_reported_without_torque(tmp_path, iiwa_model_file, bags):
    path = tmp_path / 'half.json'
    path.write_bytes(iiwa_model_file.read_bytes()[:500])
    with running({**PATIENT, 'model_file': path}) as (_, probe):
        status = probe.report('model')
        assert status.level == b'\x02' and 'half.json' in status.message
        probe.stream(part(bags['eq17_later'], 0, 20))
        assert probe.report('input').level == b'\x00' and not probe.torques
        assert not probe.call('save_model').success
    assert path.read_bytes() == iiwa_model_file.read_bytes()[:500]


def test_life_cycle(iiwa_model_file, bags):
    later = bags['eq17_later']
    with running({**PATIENT, 'model_file': iiwa_model_file, 'autostart': False},
                 wait=False) as (_, probe):
        def change(number):
            request = ChangeState.Request(transition=Transition(id=number))
            return probe.call('change_state', request=request).success

        def state():
            return probe.call('get_state').current_state.label

        probe.until(lambda: probe.answered('get_state', 2.0), 60)
        assert state() == 'unconfigured'
        assert change(Transition.TRANSITION_CONFIGURE) and state() == 'inactive'
        probe.until_node()
        probe.stream(part(later, 0, 10))
        assert not probe.torques
        assert 'not active' in probe.call('refit').message
        assert change(Transition.TRANSITION_ACTIVATE) and state() == 'active'
        probe.stream(part(later, 10, 20))
        until_last(probe, part(later, 10, 20))
        count = len(probe.torques)
        assert change(Transition.TRANSITION_DEACTIVATE)
        probe.stream(part(later, 20, 30))
        assert change(Transition.TRANSITION_CLEANUP) and state() == 'unconfigured'
        assert len(probe.torques) == count
        assert change(Transition.TRANSITION_CONFIGURE)
        assert change(Transition.TRANSITION_ACTIVATE)
        probe.until_node()
        probe.stream(part(later, 30, 40))
        until_last(probe, part(later, 30, 40))
        assert change(Transition.TRANSITION_ACTIVE_SHUTDOWN) and state() == 'finalized'


def test_torque_ramps_from_zero_after_each_activation(iiwa_model_file, bags):
    later = bags['eq17_later']
    options = {'model_file': iiwa_model_file, 'ramp_time': 0.0, 'max_torque_rate': '[]',
               'stale_action': 'hold', 'unlimited_torque': True}
    with running(options) as (_, probe):
        probe.stream(part(later, 0, 20))
        until_last(probe, part(later, 0, 20))
        whole = np.abs(probe.torques[-1].effort).max()
        assert set_parameter(probe, 'ramp_time', 60.0).successful
        for number in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
            request = ChangeState.Request(transition=Transition(id=number))
            assert probe.call('change_state', request=request).success
        count = len(probe.torques)
        assert 'waiting for input' in probe.report('feed-forward').message
        assert len(probe.torques) == count
        # At one pose: the torque of a ramp follows the motion of the arm.
        rest = replace(part(later, 20, 40), q=np.tile(later.q[0], (20, 1)))
        probe.stream(rest)
        until_last(probe, rest)
        torques = np.abs(matrix(probe.torques[count:])).max(axis=1)
        assert torques[0] == 0.0 and 0.0 < torques[-1] < 0.5 * whole


def test_stale_input_holds_then_fades(iiwa_model_file, bags):
    later = bags['eq17_later']
    options = {'model_file': iiwa_model_file, 'ramp_time': 0.0, 'max_torque_rate': '[]',
               'stale_after': 0.2, 'hold_time': 0.3, 'fade_time': 0.5, 'max_torque': '[176.0]'}
    with running(options) as (_, probe):
        probe.stream(part(later, 0, 20))
        until_last(probe, part(later, 0, 20))
        probe.until(lambda: not np.any(probe.torques[-1].effort), 60, 'zero torque')
        # On a busy machine input may be stale between joint states as well.
        last = answers(probe.torques)[-1]
        held = np.array(last.effort)
        fade = matrix(probe.torques[probe.torques.index(last):])
        status = probe.report('feed-forward')
        assert status.level == b'\x02' and 'faded to zero' in status.message
        assert 'stale' in probe.status['input'].message
        probe.stream(part(later, 20, 30))
        until_last(probe, part(later, 20, 30))
        assert np.abs(probe.torques[-1].effort).max() > 1.0
    joint = int(np.argmax(np.abs(held)))
    share = fade[:, joint] / held[joint]
    assert np.all(np.diff(share) <= 1e-12) and np.sum(share > 0.999) >= 2
    assert np.sum((share > 0.001) & (share < 0.999)) >= 2


def test_an_arm_that_compensates_gravity_itself_is_reported(bags):
    source, rng = bags['eq17_unloaded'], np.random.default_rng(2)
    with running({**UNLIMITED, **PATIENT}) as (_, probe):
        for k in range(300):
            probe.send(source.names, source.t[k], source.q[k], source.qd[k],
                       rng.normal(0.0, 0.1, 7))
            probe.spin(0.003)
        answer = probe.call('refit')
        if 'running already' in answer.message:
            probe.until(lambda: probe.report('learning')
                        and probe.values('learning')['fit process'] == 'ready', 60)
            answer = probe.call('refit')
        assert not answer.success and 'compensate gravity itself' in answer.message
        assert not probe.torques
        assert 'compensate gravity itself' in probe.report('learning').message


def test_disable_and_enable(iiwa_model_file, bags):
    later = bags['eq17_later']
    with running({**UNLIMITED, **PATIENT, 'model_file': iiwa_model_file}) as (_, probe):
        probe.stream(part(later, 0, 10))
        until_last(probe, part(later, 0, 10))
        assert np.any(probe.torques[-1].effort)
        assert probe.enable(False).success
        count = len(probe.torques)
        probe.stream(part(later, 10, 20))
        probe.report('feed-forward')
        assert len(probe.torques) == count + 1 and not np.any(probe.torques[-1].effort)
        assert probe.enable(True).success
        probe.stream(part(later, 20, 30))
        until_last(probe, part(later, 20, 30))
        assert np.any(probe.torques[-1].effort)


def test_simulated_time_drives_the_ramp(iiwa_model_file, bags):
    later = bags['eq17_later']
    options = {'use_sim_time': True, 'model_file': iiwa_model_file, 'ramp_time': 10.0,
               'stale_after': 5.0, 'max_torque_rate': '[]', 'extrapolation': 'trust',
               'diagnostics_rate': 20.0,
               'max_torque': '[1000.0]'}
    with running(options) as (_, probe):
        clock = probe.create_publisher(Clock, '/clock', 10)
        probe.until(lambda: clock.get_subscription_count() > 0, 60)
        model = load_model(iiwa_model_file)
        truth = np.array([model.predict_one(q) for q in later.q])
        message = Clock()
        for k in range(12):
            message.clock.sec = 100 + k
            # /clock is best effort and asynchronous.
            while probe.node_time != 100 + k:
                clock.publish(message)
                probe.report('model')
            probe.send(later.names, later.t[k], later.q[0], later.qd[0], later.tau[0])
            probe.until(lambda count=k + 1: len(probe.torques) == count, 60)
        torques = matrix(probe.torques)
    np.testing.assert_allclose(torques[5], 0.5 * truth[0], rtol=1e-6)
    np.testing.assert_allclose(torques[11], truth[0], rtol=1e-9)


def test_diagnose_names_the_missing_effect(iiwa_model_file, bags):
    later = bags['eq17_later']
    with running({**PATIENT, 'model_file': iiwa_model_file, 'auto_fit': False}) as (_, probe):
        answer = probe.call('diagnose')
        assert not answer.success and answer.message
        # Coulomb friction of 2 N·m on the fourth joint, which the model does not include.
        tau = later.tau + 2.0 * np.sign(later.qd) * (np.arange(7) == 3)
        for k in range(300):
            probe.send(later.names, later.t[k], later.q[k], later.qd[k], tau[k])
            probe.spin(0.003)
        answer = probe.call('diagnose')
    assert answer.success, answer.message
    assert 'Coulomb friction on joint iiwa_joint_4' in answer.message
    assert 'coulomb_friction:iiwa_joint_4 (established)' in answer.message


@pytest.mark.parametrize('reliable', [True, False])
def test_rates_and_publishers(reliable, iiwa_model_file, bags):
    later = bags['eq17_later']
    model = load_model(iiwa_model_file)
    options = {**UNLIMITED, 'model_file': iiwa_model_file, 'max_torque': '[176.0]',
               'stale_after': 10.0}
    with running(options, reliable=reliable) as (_, probe):
        for rate, first in ((10, 1000.0), (1000, 2000.0)):
            # A best-effort queue overflows on a busy machine: send until enough are answered.
            start, enough, k, result = time.monotonic(), 0.5 * max(15, rate), 0, {}
            while len(result) <= enough or k < 2 * enough:
                assert time.monotonic() < start + 60, f'{len(result)} answers to {k}'
                row = k % len(later)
                probe.send(later.names, first + k / rate, later.q[row], later.qd[row],
                           later.tau[row])
                k += 1
                probe.spin(max(1e-4, start + k / rate - time.monotonic()))
                # Without late answers to the slower messages.
                result.update((t, message) for message in probe.torques
                              if (t := stamp(message)) >= first)
                probe.torques.clear()
            assert probe.report('input').level in (b'\x00', b'\x01')
            for t, message in result.items():
                row = round((t - first) * rate) % len(later)
                assert np.abs(message.effort - model.predict_one(later.q[row])).max() < 1e-6


FAILING = """
import sys
from gravity_comp_ros.node import arm, run
learn, count = arm.Arm.learn, 0

def broken(self, reading, now):
    global count
    count += 1
    if count == 30:
        raise RuntimeError('a bug in a callback')
    learn(self, reading, now)

arm.Arm.learn = broken
sys.exit(run.run())
"""


def test_an_error_in_a_callback_brings_the_torque_to_zero_before_the_process_ends(
        iiwa_model_file, bags, tmp_path):
    """The controller would keep the last torque; a supervisor then starts the node again."""
    later, script = bags['eq17_later'], tmp_path / 'failing.py'
    script.write_text(FAILING)
    options = {**UNLIMITED, **PATIENT, 'model_file': iiwa_model_file, 'fade_time': 0.5}
    with running(options, program=(str(script),)) as (node, probe):
        for k in range(60):
            probe.send(later.names, later.t[k], later.q[k], later.qd[k], later.tau[k])
            probe.spin(0.01)
        code, output = node.wait(60)
        probe.spin(0.2)
        efforts = np.abs(matrix(probe.torques)).max(axis=1)
        assert probe.status['node'].level == b'\x02'
    assert code == 3 and 'a bug in a callback' in output
    last = int(np.flatnonzero(efforts > 1.0)[-1])
    assert efforts[-1] == 0.0 and efforts.max() > 5.0
    # The fall takes `fade_time`, 25 periods of the watchdog.
    assert len(efforts) - last >= 2 and np.abs(np.diff(efforts[-20:])).max() < 0.3 * efforts.max()
    with running(options) as (node, probe):
        probe.stream(part(later, 0, 5))
        until_last(probe, part(later, 0, 5))
        assert np.any(probe.torques[-1].effort)
