"""
The node as a separate process over DDS.

Topics, quality of service, services, parameters, life cycle, signals, clock and restart are
tested here, and one whole loop; `test/unit/node` tests the rest without ROS.
"""

from dataclasses import replace
import signal
import subprocess
import sys
import time

from bench.shared.ros_harness import (
    matrix, part, published, ROOT, running, set_parameter, stamp, until_last)
from builtin_interfaces.msg import Time
from gravity_comp_ros.commands import replay
from gravity_comp_ros.export.c_source import parameters_of
from gravity_comp_ros.export.payload_lines import Payload
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.node.outputs import LATCHED, model_message, payload_message
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage, ParameterValue
from rcl_interfaces.srv import SetParameters
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray

BAGS = ROOT / 'bags'
UNLIMITED = {'ramp_time': 0.0, 'max_torque_rate': '[]', 'extrapolation_margin': 10.0}
PATIENT = {'stale_after': 10.0, 'unlimited_torque': True}


@pytest.fixture(scope='module')
def bags():
    return {path.stem: read_bag(path).samples for path in BAGS.glob('eq17*.mcap')}


def change(probe, transition):
    request = ChangeState.Request(transition=Transition(id=transition))
    return probe.call('change_state', request=request).success


def test_a_payload_is_learned_published_saved_and_rolled_back(bags, iiwa_model_file, tmp_path):
    """The whole loop, with every output; the commands give the same torques."""
    loaded, path, models = bags['eq17_2kg'], tmp_path / 'model.json', []
    path.write_bytes(iiwa_model_file.read_bytes())
    with running({**UNLIMITED, **PATIENT, 'model_file': path}) as (_, probe):
        # Latched: the first message was published before this subscription.
        probe.create_subscription(Float64MultiArray, '/gravity_comp/model', models.append, LATCHED)
        probe.stream(part(loaded, 0, 20))
        until_last(probe, part(loaded, 0, 20), probe.residuals)
        _, stale = published(loaded, probe.residuals)
        answer = probe.call('payload_changed')
        assert answer.success and 'epoch 1 open' in answer.message
        assert 'open already' in probe.call('payload_changed').message
        probe.until(lambda: models, 60, 'the numbers of the model')
        probe.spin(0.6)
        probe.stream(part(loaded, 20, 170), period=0.01)
        probe.until(lambda: 'change of the old model' in probe.status['model'].message, 60)
        first, second = probe.call_async('refit'), probe.call_async('refit')
        probe.until(lambda: first.done() and second.done(), 60)
        texts = sorted(f.result().message for f in (first, second))
        assert any('is running already' in text for text in texts), texts
        assert set_parameter(probe, 'auto_fit', False).successful
        # An automatic fit that runs already would replace the model after it is saved.
        probe.report('learning')
        probe.until(lambda: probe.values('learning')['fit process'] == 'ready', 60)
        saved = probe.call('save_model')
        assert saved.success and str(path) in saved.message
        for messages in (probe.torques, probe.commands, probe.predictions, probe.residuals):
            messages.clear()
        later = part(loaded, 170, 250)
        probe.stream(later)
        until_last(probe, later, probe.residuals)
        probe.until(lambda: len(probe.commands) == len(probe.torques))
        assert list(probe.torques[0].name) == list(loaded.names)
        assert len(probe.extrapolations[-1].position) == len(loaded.names)
        back = probe.call('rollback')
        assert back.success and 'back to the' in back.message
        assert probe.report('learning') and 'closed' in probe.values('learning')['epoch']
        last = probe.call('rollback')
        assert not last.success and 'no model of an earlier payload' in last.message
        before = model_message(parameters_of(load_model(iiwa_model_file))).data
        probe.until(lambda: models[-1].data == before, 60, 'the numbers of the earlier model')
    model = load_model(path)
    assert models[0].data == before
    # The model that was saved is the last one before the rollback.
    np.testing.assert_allclose(models[-2].data, parameters_of(model).values, atol=1e-6)
    rows, predictions = published(loaded, probe.predictions)
    # A chain and its expansion, which the node evaluates, differ by the weights that it omits.
    np.testing.assert_allclose(predictions, model.predict(loaded.q[rows]), rtol=0, atol=1e-4)
    assert replayed(path, tmp_path)[rows] == pytest.approx(predictions, abs=1e-4)
    rows, residuals = published(loaded, probe.residuals)
    np.testing.assert_allclose(residuals, loaded.tau[rows] - model.predict(loaded.q[rows]),
                               rtol=0, atol=1e-4)
    worst = np.sqrt(np.mean(stale ** 2, axis=0)).max()
    assert worst > 2.0 > 8.0 * np.sqrt(np.mean(residuals ** 2, axis=0)).max()
    np.testing.assert_array_equal(matrix(probe.torques)[-20:],
                                  [list(m.data) for m in probe.commands][-20:])


def replayed(model, folder):
    """Return the prediction of `gravity_comp replay` for the bag of the payload."""
    out = folder / 'out.mcap'
    done = subprocess.run(
        [sys.executable, '-m', 'gravity_comp_ros.cli', 'replay', BAGS / 'eq17_2kg.mcap',
         '--model', model, '-o', out], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return read_bag(out, ReadOptions(topic=replay.PREDICTION)).samples.tau


def test_a_payload_as_a_message():
    payload = Payload('tool0', Quantity(2.0, 'kg', (1.9, 2.1)), {
        axis: Quantity(value, 'm', (value, value)) for axis, value in zip('xyz', (0.1, 0.2, 0.3))})
    message = payload_message(payload, Time(sec=3))
    assert message.header.frame_id == 'tool0' and message.header.stamp.sec == 3
    assert np.isnan(payload_message(None, Time()).inertia.m)
    assert message.inertia.m == 2.0 and message.inertia.ixx == 0.0
    assert (message.inertia.com.x, message.inertia.com.y, message.inertia.com.z) == (0.1, 0.2, 0.3)


def test_a_message_names_every_number(iiwa_model_file):
    parameters = parameters_of(load_model(iiwa_model_file))
    message = model_message(parameters)
    assert [dim.label for dim in message.layout.dim[1:]] == parameters.labels
    assert int(message.layout.dim[0].label, 16) == parameters.layout
    assert message.layout.dim[0].size == len(message.data)
    assert message.layout.dim[1].label == 'iiwa_joint_1 q_min rad'
    np.testing.assert_array_equal(message.data, parameters.values)


def test_life_cycle_and_enable(iiwa_model_file, bags):
    later = bags['eq17_later']
    options = {**UNLIMITED, 'model_file': iiwa_model_file, 'stale_action': 'hold',
               'unlimited_torque': True, 'autostart': False}
    with running(options, wait=False) as (_, probe):
        def state():
            return probe.call('get_state').current_state.label

        probe.until(lambda: probe.answered('get_state', 2.0), 60)
        assert state() == 'unconfigured'
        assert change(probe, Transition.TRANSITION_CONFIGURE) and state() == 'inactive'
        probe.until_node()
        probe.stream(part(later, 0, 10))
        # A tool is changed, and torque is forbidden, also while the node is inactive.
        reply = probe.call('payload_changed')
        assert reply.success and 'inactive; epoch 1 open' in reply.message and not probe.torques
        assert probe.enable(False).success
        assert change(probe, Transition.TRANSITION_ACTIVATE) and state() == 'active'
        probe.report('feed-forward')
        assert probe.values('feed-forward')['enabled'] == 'false' and probe.enable(True).success
        probe.stream(part(later, 10, 20))
        until_last(probe, part(later, 10, 20))
        whole = np.abs(probe.torques[-1].effort).max()
        assert whole > 1.0 and probe.enable(False).success
        probe.stream(part(later, 20, 22))
        # Zero is published once; the newest of waiting messages is answered.
        probe.until(lambda: not np.any(probe.torques[-1].effort), 60, 'zero torque')
        count = len(probe.torques)
        probe.stream(part(later, 22, 26))
        probe.report('feed-forward')
        assert len(probe.torques) == count and probe.enable(True).success
        # At one pose: the torque of a ramp follows the motion of the arm.
        assert set_parameter(probe, 'ramp_time', 60.0).successful
        for action in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
            assert change(probe, action)
        assert 'waiting for input' in probe.report('feed-forward').message
        count = len(probe.torques)
        rest = replace(part(later, 26, 40), q=np.tile(later.q[0], (14, 1)))
        probe.stream(rest)
        until_last(probe, rest)
        torques = np.abs(matrix(probe.torques[count:])).max(axis=1)
        assert torques[0] == 0.0 and 0.0 < torques[-1] < 0.5 * whole
        # A call that waits is answered, although its node is cleaned up meanwhile.
        probe.stream(part(later, 50, 120))
        waiting = probe.call_async('refit')
        assert change(probe, Transition.TRANSITION_DEACTIVATE)
        assert change(probe, Transition.TRANSITION_CLEANUP) and state() == 'unconfigured'
        probe.until(waiting.done, 60, 'the answer to a call that waited')
        assert waiting.result().message and 'not configured' in probe.call('refit').message
        count = len(probe.torques)
        probe.stream(part(later, 40, 50))
        assert len(probe.torques) == count
        for action in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
            assert change(probe, action)
        probe.until_node()
        probe.stream(part(later, 50, 60))
        until_last(probe, part(later, 50, 60))
        # The controller has kept the torque from before the cleanup.
        first, last = matrix(probe.torques)[[count, count - 1]]
        assert np.abs(first - last).max() < 0.05 * whole
        # Neither a transition of another state nor an error of rclpy ends the torque.
        assert not change(probe, Transition.TRANSITION_CONFIGURE)
        probe.call_async('set_parameters', SetParameters.Request(parameters=[
            ParameterMessage(name='max_speed', value=ParameterValue(type=77))]))
        probe.until(lambda: probe.status['node'].level == b'\x02', 60, 'the error reported')
        probe.stream(part(later, 60, 70))
        until_last(probe, part(later, 60, 70))
        assert change(probe, Transition.TRANSITION_ACTIVE_SHUTDOWN) and state() == 'finalized'


# Refused by the node, by its types and as read-only; test_node_parameters has the other values.
WRONG_PARAMETERS = [
    ('max_torque', [1.0, 2.0], '2 values for 7 joints'), ('max_speed', 'fast', 'parameter type'),
    ('joints', ['a'], 'read-only'), ('effects', ['gremlins'], 'gremlins')]
# Many more than the default depth of a queue.
CALLS = 150


def test_parameters_and_storms_of_calls(iiwa_model_file, bags, tmp_path):
    path = tmp_path / 'model.json'
    path.write_bytes(iiwa_model_file.read_bytes())
    with running({**PATIENT, 'model_file': path, 'auto_fit': False}) as (node, probe):
        # Rest: the arm is known, and there is too little motion for any fit.
        later = bags['eq17_later']
        rest = replace(part(later, 0, 5), q=np.tile(later.q[0], (5, 1)))
        probe.stream(rest)
        until_last(probe, rest)
        for name, value, why in WRONG_PARAMETERS:
            result = set_parameter(probe, name, value)
            assert not result.successful and why in result.reason, (name, result)
        for name, value in (('max_torque', [100.0]), ('max_speed', 1.0),
                            ('effects', ['coulomb_friction'])):
            assert set_parameter(probe, name, value).successful
        for name in ('refit', 'payload_changed', 'rollback', 'diagnose', 'save_model'):
            storm = [probe.call_async(name) for _ in range(CALLS if name == 'refit' else 20)]
            probe.until(lambda calls=storm: all(call.done() for call in calls), 60,
                        f'all answers of {name}')
            assert all(call.result().message for call in storm)
        assert load_model(path).joints == later.names
        code, output = node.stop(signal.SIGTERM, timeout=60)
    assert code == 0 and 'Traceback' not in output, output


def test_bad_parameters_at_the_start_end_it_with_one_line():
    with running({'joints': '[a,b]', 'max_torque': '[1.0,2.0,3.0]'}, wait=False) as (node, _):
        code, output = node.wait(60)
    assert code == 1 and '3 values for 2 joints' in output and 'Traceback' not in output, output
    assert len(output.strip().splitlines()) == 1


def test_signals_during_startup_end_it_without_a_traceback(iiwa_model_file):
    for after, number in ((0.3, signal.SIGINT), (0.8, signal.SIGTERM), (1.4, signal.SIGINT)):
        with running({'model_file': iiwa_model_file}, wait=False) as (node, probe):
            probe.spin(after)
            code, output = node.stop(number, timeout=60)
        # Before Python handles signals, the default action ends the process, or its start fails.
        assert code in (0, -number) or 'init_import_site' in output, output
        assert 'Traceback' not in output or 'gravity_comp_ros' not in output, output


def test_rates_of_a_best_effort_publisher_and_a_gap(iiwa_model_file, bags):
    later, model = bags['eq17_later'], load_model(iiwa_model_file)
    options = {**UNLIMITED, 'model_file': iiwa_model_file, 'max_torque': '[176.0]',
               'stale_after': 0.5, 'stale_action': 'hold'}
    with running(options, reliable=False) as (node, probe):
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
                # Without late answers to the slower messages, and torque without input.
                result.update((t, message) for message in probe.torques
                              if first <= (t := stamp(message)) < 1e6)
                probe.torques.clear()
            for t, message in result.items():
                row = round((t - first) * rate) % len(later)
                assert np.abs(message.effort - model.predict_one(later.q[row])).max() < 1e-6
        probe.until(lambda: 'holding' in probe.status['feed-forward'].message, 60, 'the gap')
        assert probe.status['feed-forward'].level == b'\x02'
        assert 'stale' in probe.status['input'].message
        probe.torques.clear()
        probe.until(lambda: probe.torques, 60, 'torque without input')
        # Of the last message, which on a busy machine may not be the one that was sent last.
        poses = np.array([model.predict_one(q) for q in later.q])
        assert np.abs(poses - probe.torques[0].effort).max(axis=1).min() < 1e-6
        # Without /clock simulated time stands still; torque without input goes on nevertheless.
        assert set_parameter(probe, 'use_sim_time', True).successful
        probe.report('feed-forward')
        probe.torques.clear()
        probe.until(lambda: probe.torques, 10, 'torque without input')
        code, output = node.stop(signal.SIGINT, timeout=60)
    assert code == 0 and 'Traceback' not in output, output


# A bug that a message with this effort uncovers.
FAILING = """
import sys
from gravity_comp_ros.node import arm, run
learn = arm.Arm.learn

def broken(self, reading, now):
    if reading.tau[0] == 777.0:
        raise RuntimeError('a bug in a callback')
    learn(self, reading, now)

arm.Arm.learn = broken
sys.exit(run.run())
"""


def test_simulated_time_and_an_error_in_a_callback(iiwa_model_file, bags, tmp_path):
    """
    The ramp follows /clock; after an error the torque falls to zero, although /clock stands still.

    The controller would keep the last torque; a supervisor then starts the node again.
    """
    later, script = bags['eq17_later'], tmp_path / 'failing.py'
    script.write_text(FAILING)
    options = {**UNLIMITED, 'model_file': iiwa_model_file, 'ramp_time': 10.0, 'stale_after': 5.0,
               'max_torque': '[1000.0]', 'fade_time': 0.5}
    with running({**options, 'use_sim_time': True}, program=(str(script),)) as (node, probe):
        probe.send(later.names, later.t[0], later.q[0], later.qd[0], later.tau[0])
        assert probe.report('clock').level == b'\x02' and not probe.torques
        clock, message = probe.create_publisher(Clock, '/clock', 10), Clock()
        probe.until(lambda: clock.get_subscription_count() > 0, 60)
        for k, now in enumerate((100, 101, 102, 103, 104, 105, 40, 41, 41)):
            message.clock.sec = now
            # /clock is best effort and asynchronous.
            while probe.node_time != now:
                clock.publish(message)
                probe.report('model')
            probe.send(later.names, later.t[k + 1], later.q[0], later.qd[0], later.tau[0])
            probe.until(lambda count=k + 1: len(probe.torques) == count, 60)
        share = matrix(probe.torques) / load_model(iiwa_model_file).predict_one(later.q[0])
        np.testing.assert_allclose(share[:6, 1], 0.1 * np.arange(6), rtol=1e-6)
        # A clock that is set back or stands still does not move the ramp.
        np.testing.assert_allclose(share[5:, 1], [0.5, 0.5, 0.6, 0.6], rtol=1e-6)
        count = len(probe.torques)
        tau = np.array([777.0, *later.tau[11][1:]])
        probe.send(later.names, later.t[11], later.q[0], later.qd[0], tau)
        code, output = node.wait(60)
        probe.until(lambda: not np.any(probe.torques[-1].effort), 60, 'zero torque')
        efforts = np.abs(matrix(probe.torques[count:])).max(axis=1)
        probe.until(lambda: probe.status['node'].level == b'\x02', 60, 'the error reported')
    assert code == 3 and 'a bug in a callback' in output
    # The fall takes `fade_time`, 25 periods of the watchdog.
    assert len(efforts) > 5 and np.abs(np.diff(efforts)).max() < 0.5 * efforts.max()
    with running({**options, **PATIENT}) as (_, probe):
        probe.stream(part(later, 0, 20), period=0.05)
        until_last(probe, part(later, 0, 20))
        first = matrix(probe.torques)[0]
        assert not first.any() and np.any(probe.torques[-1].effort)
