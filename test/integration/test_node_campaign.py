"""
Campaign of faults against the running node: no fault causes a wrong torque.

After each fault (`FaultInjector.fault`) each published torque is that of the model at a pose that
was sent, the node runs and answers the next valid message, and the model file is unchanged or a
complete new one. Each test also asserts that diagnostics or a reply report the fault.
"""

from contextlib import contextmanager, suppress
import os
from pathlib import Path
import shutil
import signal
import time

from bench.shared.ros_harness import ROOT, running, set_parameter
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.bag import read_bag
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.slow

NAMES = [f'iiwa_joint_{k}' for k in range(1, 8)]
NAN, INF = float('nan'), float('inf')
FAST = {'diagnostics_rate': 20.0, 'ramp_time': 0.0, 'max_torque_rate': '[]',
        'max_torque': '[176.0]', 'stale_after': 10.0, 'stale_action': 'hold',
        'auto_fit': False}
# Rounding error of the published torque, N·m.
BOUND = 1e-6


@pytest.fixture(scope='module')
def recording():
    return read_bag(ROOT / 'bags' / 'eq17_later.mcap').samples


@pytest.fixture
def model_file(iiwa_model_file, tmp_path):
    """Return a copy of the model file for this test."""
    return Path(shutil.copy(iiwa_model_file, tmp_path / 'model.json'))


class FaultInjector:
    """Sends faults, keeps the poses that were sent, and checks each torque."""

    def __init__(self, node, probe, recording, path):
        self.node, self.probe, self.recording, self.path = node, probe, recording, path
        self.model, self.bytes = load_model(path), path.read_bytes()
        self.k, self.t = 0, 100000.0
        self.poses, self.last = {}, None

    def send_valid(self, **change):
        """Send a valid joint state, or one with replaced fields."""
        self.k, self.t = (self.k + 1) % len(self.recording), self.t + 0.2
        pose = self.recording.q[self.k]
        message = JointState(name=NAMES, position=pose.tolist(),
                             velocity=self.recording.qd[self.k].tolist(),
                             effort=self.recording.tau[self.k].tolist())
        for field, value in change.items():
            if field != 't':
                setattr(message, field, value)
        t = change.get('t', self.t)
        message.header.stamp.sec = int(t)
        message.header.stamp.nanosec = int(round((t - int(t)) * 1e9))
        # A second message with the same stamp is a fault, and its pose must not be used.
        self.poses.setdefault((message.header.stamp.sec, message.header.stamp.nanosec), pose)
        self.probe.publisher.publish(message)
        return message

    @contextmanager
    def fault(self, name):
        """Check the state of the node after a fault."""
        yield
        assert self.node.process.poll() is None, f'the node died of: {name}'
        self.answered(name)
        assert self.path.read_bytes() == self.bytes, f'the model file changed by: {name}'

    def answered(self, after='the start'):
        """Send valid messages until one is answered; check all torques."""
        count = len(self.probe.torques)
        end = time.monotonic() + 60.0
        while len(self.probe.torques) == count:
            assert time.monotonic() < end, f'no valid message is answered after: {after}'
            self.send_valid()
            self.probe.spin(0.02)
        self.check()

    def check(self):
        """Check each torque published since the last call."""
        for message in self.probe.torques:
            tau = np.array(message.effort)
            assert list(message.name) == NAMES and np.isfinite(tau).all()
            stamp = message.header.stamp.sec, message.header.stamp.nanosec
            # On a busy machine input may be stale, and the last torque is held.
            pose = self.last = self.poses.get(stamp, self.last)
            assert np.abs(tau - self.model.predict_one(pose)).max() < BOUND
        self.probe.torques.clear()
        for command in self.probe.commands:
            assert len(command.data) == 7 and np.isfinite(command.data).all()
        self.probe.commands.clear()

    def count(self, reason):
        if 'input' not in self.probe.status:
            return 0
        return int(self.probe.values('input').get(f'count {reason}', 0))


def send_shuffled(field):
    """Send a joint state with its joints in another order and with unknown joints."""
    order = [3, 0, 6, 1, 5, 2, 4]
    message = field.send_valid()
    pose = field.poses[(message.header.stamp.sec, message.header.stamp.nanosec)]
    field.t += 0.2
    field.poses[(int(field.t), int(round((field.t - int(field.t)) * 1e9)))] = pose
    shuffled = JointState(name=['gripper', *(NAMES[k] for k in order), 'wheel'],
                          position=[9.0, *(pose[k] for k in order), NAN])
    shuffled.header.stamp.sec = int(field.t)
    shuffled.header.stamp.nanosec = int(round((field.t - int(field.t)) * 1e9))
    field.probe.publisher.publish(shuffled)


def part(**change):
    return lambda field: field.send_valid(**change)


SEVEN = [0.1] * 7
INPUT_FAULTS = [
    ('no names', part(name=[]), 'other_joints'),
    ('other joints alone', part(name=[f'x{k}' for k in range(7)]), 'other_joints'),
    ('one joint missing', part(name=NAMES[:6], position=SEVEN[:6]), 'missing_joint'),
    ('one joint renamed', part(name=[*NAMES[:6], 'j7']), 'missing_joint'),
    ('upper case', part(name=[n.upper() for n in NAMES[:3]] + NAMES[3:]), 'missing_joint'),
    ('a joint twice', part(name=[*NAMES[:6], NAMES[0]]), 'duplicate_joint'),
    ('all twice', part(name=NAMES * 2, position=SEVEN * 2), 'duplicate_joint'),
    ('no positions', part(position=[]), 'wrong_size'),
    ('positions short', part(position=SEVEN[:5]), 'wrong_size'),
    ('positions long', part(position=SEVEN + [1.0]), 'wrong_size'),
    ('a NaN position', part(position=[*SEVEN[:6], NAN]), 'position_not_finite'),
    ('all NaN', part(position=[NAN] * 7), 'position_not_finite'),
    ('an infinite position', part(position=[INF, *SEVEN[:6]]), 'position_not_finite'),
    ('minus infinity', part(position=[*SEVEN[:6], -INF]), 'position_not_finite'),
    ('an encoder fault', part(position=[1e300, *SEVEN[:6]]), 'position_absurd'),
    ('many turns', part(position=[*SEVEN[:6], -1e6]), 'position_absurd'),
    ('no effort', part(effort=[]), 'no_effort'),
    ('efforts short', part(effort=[1.0]), 'wrong_size'),
    ('a NaN effort', part(effort=[NAN] * 7), 'effort_not_finite'),
    ('an infinite effort', part(effort=[*SEVEN[:6], INF]), 'effort_not_finite'),
    ('no velocity', part(velocity=[]), 'no_velocity'),
    ('velocities long', part(velocity=SEVEN * 2), 'wrong_size'),
    ('a NaN velocity', part(velocity=[NAN, *SEVEN[:6]]), 'velocity_not_finite'),
    ('an infinite velocity', part(velocity=[-INF] * 7), 'velocity_not_finite'),
    ('positions alone, shuffled, with unknown joints', send_shuffled, 'no_velocity'),
]


def test_input_faults(recording, model_file):
    with running({**FAST, 'model_file': model_file}) as (node, probe):
        field = FaultInjector(node, probe, recording, model_file)
        field.answered()
        for name, fire, reason in INPUT_FAULTS:
            before = field.count(reason)
            with field.fault(name):
                fire(field)
                probe.until(lambda was=before, why=reason: field.count(why) > was, 60,
                            f'naming {reason} after {name}')
        for name, fire, reason in CLOCK_FAULTS:
            before = field.count(reason)
            with field.fault(name):
                fire(field)
            probe.until(lambda was=before, why=reason: field.count(why) > was, 60,
                        f'naming {reason} after {name}')
        with field.fault('a burst'):
            for _ in range(80):
                field.send_valid()
            last = round(field.t % 1.0, 6)
            probe.until(lambda: any(round(1e-9 * message.header.stamp.nanosec, 6) == last
                                    and message.header.stamp.sec == int(field.t)
                                    for message in probe.torques), 60, 'the newest answered')
        assert probe.status['learning'].level != b'\x02'
        code, output = node.stop(timeout=60)
    assert code == 0 and 'Traceback' not in output, output


def stamped(shift=None, exactly=None):
    """Return a fault: a message with an equal, earlier or missing stamp."""
    def fire(field):
        field.send_valid(t=field.t + shift if exactly is None else exactly)
        field.t -= 0.2
    return fire


def jump(seconds):
    """Return a fault: the clock jumps."""
    def fire(field):
        field.t += seconds
        field.answered()
    return fire


CLOCK_FAULTS = [
    ('time stands still', stamped(0.0), 'time_still'),
    ('time goes back a little', stamped(-0.5), 'time_back'),
    ('time goes back a quarter of an hour', stamped(-900.0), 'time_back'),
    ('a stamp of zero among others', stamped(exactly=0.0), 'time_back'),
    ('the clock is set back', jump(-500.0), 'clock_jump'),
    ('the clock is set back by hours', jump(-9000.0), 'clock_jump'),
]


@pytest.mark.parametrize('reliable', [True, False])
def test_a_gap_is_reported_and_torque_returns(reliable, recording, model_file):
    """Input stops for longer than `stale_after`, with either reliability of the publisher."""
    options = {**FAST, 'model_file': model_file, 'stale_after': 0.3, 'stale_action': 'hold'}
    with running(options, reliable=reliable) as (node, probe):
        field = FaultInjector(node, probe, recording, model_file)
        field.send_valid()
        probe.until(lambda: 'stale' in probe.status['input'].message, 60, 'the gap named')
        probe.until(lambda: probe.status['feed-forward'].level == b'\x02', 60)
        assert 'holding' in probe.status['feed-forward'].message
        poses = [field.model.predict_one(pose) for pose in field.poses.values()]
        for message in probe.torques:
            assert min(np.abs(np.array(message.effort) - tau).max() for tau in poses) < BOUND
        probe.torques.clear()
        # Torque on stale input has the present time as stamp and is not checked.
        end = time.monotonic() + 60.0
        while 'messages' not in probe.status['input'].message:
            assert time.monotonic() < end
            field.send_valid()
            probe.spin(0.02)
        assert node.process.poll() is None and model_file.read_bytes() == field.bytes


SIMULATED = [('the simulation starts again', [50.0, 50.1]), ('it pauses', [50.1, 50.1, 50.1]),
             ('it leaps', [5000.0, 5000.1])]


def test_a_simulated_clock_that_jumps(recording, model_file):
    options = {**FAST, 'model_file': model_file, 'use_sim_time': True, 'stale_after': 1.0,
               'stale_action': 'fade', 'hold_time': 0.5, 'fade_time': 2.0}
    with running(options) as (node, probe):
        field = FaultInjector(node, probe, recording, model_file)
        clock = probe.create_publisher(Clock, '/clock', 10)
        probe.until(lambda: clock.get_subscription_count() > 0)
        for name, times in [('it starts', [100.0, 100.1]), *SIMULATED]:
            probe.torques.clear()
            for t in times:
                message = Clock()
                message.clock.sec, message.clock.nanosec = int(t), round((t % 1) * 1e9)
                seen = len(probe.torques)

                def answered(message=message, seen=seen):
                    # The first may be lost before discovery is complete in both directions.
                    clock.publish(message)
                    probe.spin(0.1)
                    field.send_valid()
                    return len(probe.torques) > seen

                probe.until(answered, 60, f'an answer after {name}')
            bound = max(np.abs(field.model.predict_one(q)).max() for q in field.poses.values())
            assert all(np.abs(m.effort).max() <= bound + BOUND for m in probe.torques), name
            assert node.process.poll() is None
        assert model_file.read_bytes() == field.bytes


WRONG_PARAMETERS = [
    ('max_speed', NAN), ('max_speed', -1.0), ('max_torque', [INF]), ('max_torque', [1.0, 2.0]),
    ('max_torque', ['much']), ('formulation', ''), ('ramp_time', -1.0),
    ('stale_action', 'drop'), ('joints', ['a']), ('model_file', '/etc/passwd'),
    ('effects', ['gremlins']), ('compensate', ['inertia']), ('no_such_parameter', 1)]
STORMS = ('refit', 'payload_changed', 'rollback', 'diagnose', 'save_model')
# Many more than the default depth of a queue.
CALLS = 60


def test_invalid_calls_and_parameters(recording, model_file):
    with running({**FAST, 'model_file': model_file}) as (node, probe):
        field = FaultInjector(node, probe, recording, model_file)
        field.answered()
        for name, value in WRONG_PARAMETERS:
            with field.fault(f'parameter {name} = {value}'):
                result = set_parameter(probe, name, value)
                assert not result.successful
                # rclpy refuses some values with its own message.
                assert any(word in result.reason
                           for word in (name, 'read-only', 'undeclared parameter',
                                        'parameter type')), result
        for name in ('refit', 'diagnose', 'rollback'):
            with field.fault(f'{name} without data'):
                answer = probe.call(name)
                assert not answer.success and answer.message
        for name in STORMS:
            with field.fault(f'a storm of {name}'):
                count = 3 * CALLS if name == 'refit' else CALLS
                storm = [probe.call_async(name) for _ in range(count)]
                probe.until(lambda calls=storm: all(call.done() for call in calls), 60,
                            f'all answers of {name}')
                assert all(call.result().message for call in storm)


PROCESS_FAULTS = ((signal.SIGKILL, 'died (signal 9)'), (signal.SIGSEGV, 'died (signal 11)'),
                  (signal.SIGSTOP, 'the fit hung'))


def test_faults_of_the_fit_process(recording, model_file):
    with running({**FAST, 'model_file': model_file}) as (node, probe):
        field = FaultInjector(node, probe, recording, model_file)
        for _ in range(200):
            field.send_valid()
            probe.spin(0.004)
        for number, message in PROCESS_FAULTS:
            probe.until(lambda: 'learning' in probe.status
                        and probe.values('learning')['fit process'] == 'ready', 60,
                        'a fit process')
            pid = int(probe.values('learning')['fit process id'])
            with field.fault(f'the fit process {message}'):
                os.kill(pid, signal.SIGSTOP)
                waiting = probe.call_async('refit')
                probe.until(lambda: probe.values('learning')['fit process'] == 'fitting', 60)
                os.kill(pid, number)
                if number == signal.SIGSEGV:
                    # A stopped process gets this signal when it continues.
                    os.kill(pid, signal.SIGCONT)
                elif number == signal.SIGSTOP:
                    assert set_parameter(probe, 'fit_timeout', 2.0).successful
                probe.until(waiting.done, 60, 'the answer')
                assert not waiting.result().success and message in waiting.result().message
                probe.until(lambda text=message: text in probe.status['learning'].message, 60)
                assert probe.status['learning'].level == b'\x02'
        # Killed while idle, and again before it has restarted.
        for _ in range(2):
            with field.fault('the idle fit process is killed'):
                old = probe.values('learning')['fit process id']
                with suppress(ProcessLookupError):
                    # The report may still have the id of the killed process.
                    if old:
                        os.kill(int(old), signal.SIGKILL)
                probe.until(lambda was=old: probe.values('learning')['fit process id'] != was)


WRONG_FILES = [('half a file', lambda whole: whole[:len(whole) // 2]), ('nothing', lambda _: b''),
               ('a changed digit', lambda whole: whole.replace(b'0.', b'7.', 1)),
               ('another format', lambda _: b'{"format": "a cake"}')]


def test_a_damaged_model_file_is_reported_and_not_changed(model_file, recording):
    whole = model_file.read_bytes()
    with running({**FAST, 'model_file': model_file}) as (node, probe):
        for name, damage in WRONG_FILES:
            for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
                assert changed_state(probe, transition), name
            damaged = damage(whole)
            model_file.write_bytes(damaged)
            for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
                assert changed_state(probe, transition), name
            probe.until_node()
            status = probe.report('model')
            assert status.level == b'\x02' and 'model.json' in status.message, name
            probe.stream(recording.select(np.arange(20)))
            assert node.process.poll() is None and not probe.torques and not probe.commands, name
            assert not probe.call('save_model').success, name
            assert model_file.read_bytes() == damaged, name


def changed_state(probe, transition):
    request = ChangeState.Request(transition=Transition(id=transition))
    return probe.call('change_state', request=request).success


def test_a_model_file_of_another_arm(model_file, recording):
    with running({**FAST, 'model_file': model_file, 'joints': '[a, b]'}) as (_, probe):
        status = probe.report('model')
        assert status.level == b'\x02' and 'a, b' in status.message and not probe.torques


KILLS = 3


def test_killed_while_saving_the_file_is_old_or_new(model_file, recording):
    for kill in range(KILLS):
        with running({**FAST, 'model_file': model_file}) as (node, probe):
            assert probe.report('model').level == b'\x00'
            field = FaultInjector(node, probe, recording, model_file)
            field.answered()
            for _ in range(20):
                probe.call_async('save_model')
            probe.spin(0.002 * (1 + 3 * kill))
            node.process.kill()
        load_model(model_file)
    missing_folder(model_file, recording)


def missing_folder(path, recording):
    """Save into a missing folder: the error is reported, and the file is unchanged."""
    before = path.read_bytes()
    for path_left in path.parent.glob('.model.json.*'):
        path_left.unlink()
    with running({**FAST, 'model_file': path}) as (node, probe):
        probe.report('model')
        path.parent.rename(path.parent.with_suffix('.away'))
        answer = probe.call('save_model')
        path.parent.with_suffix('.away').rename(path.parent)
        assert not answer.success and 'nothing was changed' in answer.message
        assert node.process.poll() is None
    assert path.read_bytes() == before and len(list(path.parent.iterdir())) == 1


def test_the_campaign_has_at_least_seventy_faults():
    # In addition to the tables: a burst, a gap with either publisher, three calls without data,
    # two kills while idle, a model of another arm, a missing folder.
    counted = [*INPUT_FAULTS, *CLOCK_FAULTS, *SIMULATED, *WRONG_PARAMETERS, *STORMS,
               *PROCESS_FAULTS, *WRONG_FILES, *range(KILLS + 1 + 2 + 3 + 2 + 1 + 1)]
    assert len(counted) >= 70
