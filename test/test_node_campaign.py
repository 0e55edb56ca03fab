"""
A campaign of faults against one running node: whatever comes, no wrong torque goes out.

After every fault: the node lives, each torque that it published is that of its model at a pose
that was really sent, diagnostics name the fault, and the next good message is answered.
"""

import os
import signal
import time

from gravity_comp_ros.bag import read_bag
from gravity_comp_ros.gate import slow_samples
from gravity_comp_ros.gravity.fit import fit
from gravity_comp_ros.modelfile import load_model, save_model
import numpy as np
import pytest
from ros_harness import ROOT, running, set_parameter
from sensor_msgs.msg import JointState

NAMES = [f'iiwa_joint_{k}' for k in range(1, 8)]
NAN, INF = float('nan'), float('inf')
FAST = {'diagnostics_rate': 20.0, 'ramp_time': 0.0, 'max_torque_rate': '[]',
        'max_torque': '[176.0]', 'stale_after': 10.0, 'auto_fit': False}
# N·m; the model's own torque is compared, so only rounding is between them.
BOUND = 1e-6


@pytest.fixture(scope='module')
def recording():
    return read_bag(ROOT / 'bags' / 'eq17_later.mcap').samples


@pytest.fixture(scope='module')
def model_file(tmp_path_factory):
    path = tmp_path_factory.mktemp('models') / 'model.json'
    samples = read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples
    save_model(path, fit(slow_samples(samples).samples).model)
    return path


class Range:
    """Where faults are fired: keeps every pose that was sent, and checks every torque."""

    def __init__(self, probe, recording, model):
        self.probe, self.recording, self.model = probe, recording, model
        self.k, self.t = 0, 1000.0
        self.poses = {}

    def good(self, **change):
        """Send a good joint state, or one with parts replaced."""
        self.k, self.t = (self.k + 1) % len(self.recording), self.t + 0.2
        pose = self.recording.q[self.k]
        message = JointState(name=NAMES, position=pose.tolist(), velocity=[0.0] * 7,
                             effort=self.recording.tau[self.k].tolist())
        for field, value in change.items():
            if field != 't':
                setattr(message, field, value)
        t = change.get('t', self.t)
        message.header.stamp.sec = int(t)
        message.header.stamp.nanosec = int(round((t - int(t)) * 1e9))
        self.poses[(message.header.stamp.sec, message.header.stamp.nanosec)] = pose
        self.probe.publisher.publish(message)
        return message

    def answered(self):
        """Send a good message until one is answered; check everything that came."""
        count = len(self.probe.torques)
        end = time.monotonic() + 10.0
        while len(self.probe.torques) == count:
            assert time.monotonic() < end, 'a good message is no longer answered'
            self.good()
            self.probe.spin(0.02)
        self.check()

    def check(self):
        """Check every torque that was published since the last time."""
        for message in self.probe.torques:
            tau = np.array(message.effort)
            assert list(message.name) == NAMES and np.isfinite(tau).all()
            pose = self.poses[(message.header.stamp.sec, message.header.stamp.nanosec)]
            assert np.abs(tau - self.model.predict_one(pose)).max() < BOUND
        self.probe.torques.clear()
        for command in self.probe.commands:
            assert len(command.data) == 7 and np.isfinite(command.data).all()
        self.probe.commands.clear()

    def count(self, reason):
        if 'input' not in self.probe.status:
            return 0
        return int(self.probe.values('input').get(f'count {reason}', 0))


def mixed(recording):
    """Return the same joint state with its joints in another order, and strangers among them."""
    order = [3, 0, 6, 1, 5, 2, 4]

    def fire(field):
        message = field.good()
        pose = field.poses[(message.header.stamp.sec, message.header.stamp.nanosec)]
        field.t += 0.2
        field.poses[(int(field.t), int(round((field.t - int(field.t)) * 1e9)))] = pose
        shuffled = JointState(name=['gripper', *(NAMES[k] for k in order), 'wheel'],
                              position=[9.0, *(pose[k] for k in order), NAN])
        shuffled.header.stamp.sec = int(field.t)
        shuffled.header.stamp.nanosec = int(round((field.t - int(field.t)) * 1e9))
        field.probe.publisher.publish(shuffled)
    return fire


def part(**change):
    return lambda field: field.good(**change)


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
    ('an encoder gone mad', part(position=[1e300, *SEVEN[:6]]), 'position_absurd'),
    ('many turns', part(position=[*SEVEN[:6], -1e6]), 'position_absurd'),
    ('no effort', part(effort=[]), 'no_effort'),
    ('efforts short', part(effort=[1.0]), 'wrong_size'),
    ('a NaN effort', part(effort=[NAN] * 7), 'effort_not_finite'),
    ('an infinite effort', part(effort=[*SEVEN[:6], INF]), 'effort_not_finite'),
    ('no velocity', part(velocity=[]), 'no_velocity'),
    ('velocities long', part(velocity=SEVEN * 2), 'wrong_size'),
    ('a NaN velocity', part(velocity=[NAN, *SEVEN[:6]]), 'velocity_not_finite'),
    ('an infinite velocity', part(velocity=[-INF] * 7), 'velocity_not_finite'),
    ('positions alone, shuffled, among strangers', mixed(None), 'no_velocity'),
]


def test_input_faults(recording, model_file):
    with running({**FAST, 'model_file': model_file}) as (node, probe):
        field = Range(probe, recording, load_model(model_file))
        field.answered()
        for name, fire, reason in INPUT_FAULTS:
            before = field.count(reason)
            fire(field)
            probe.until(lambda was=before, why=reason: field.count(why) > was, 60,
                        f'naming {reason} after {name}')
            field.answered()
            assert node.process.poll() is None, name
        clock_faults(field)
        burst_and_gap(field)
        assert probe.status['learning'].level != b'\x02'
        code, output = node.stop()
    assert code == 0 and 'Traceback' not in output, output


def clock_faults(field):
    """Time still, back a little, back for good, a leap ahead and home again, no stamps."""
    probe = field.probe
    for name, t, reason in [('still', field.t, 'time_still'),
                            ('back a little', field.t - 0.5, 'time_back'),
                            ('back an hour', field.t - 900.0, 'time_back'),
                            ('zero', 0.0, 'time_back')]:
        before = field.count(reason)
        field.good(t=t)
        field.t -= 0.2
        probe.until(lambda was=before, why=reason: field.count(why) > was, 60, f'time {name}')
        field.answered()
    for leap in (-500.0, 10000.0, -9000.0):
        jumps = field.count('clock_jump')
        field.t += leap
        field.answered()
        if leap < 0:
            probe.until(lambda was=jumps: field.count('clock_jump') > was, 60, 'the clock jump')


def burst_and_gap(field):
    for _ in range(80):
        field.good()
    field.probe.until(lambda: len(field.probe.torques) >= 80, 60, 'the burst handled')
    field.check()
    field.probe.spin(0.5)
    field.answered()


def test_calls_and_parameters_that_make_no_sense(recording, model_file):
    with running({**FAST, 'model_file': model_file}) as (node, probe):
        field = Range(probe, recording, load_model(model_file))
        field.answered()
        for name, value in [
                ('max_speed', NAN), ('max_speed', -1.0), ('max_torque', [INF]),
                ('max_torque', [1.0, 2.0]), ('max_torque', ['much']), ('formulation', ''),
                ('ramp_time', -1.0), ('stale_action', 'drop'), ('joints', ['a']),
                ('model_file', '/etc/passwd'), ('no_such_parameter', 1)]:
            result = set_parameter(probe, name, value)
            assert not result.successful and result.reason, name
            field.answered()
        refused = [probe.call(name) for name in ('refit', 'diagnose', 'rollback')]
        assert all(not answer.success and answer.message for answer in refused)
        for name in ('refit', 'payload_changed', 'rollback', 'diagnose'):
            storm = [probe.ask(name) for _ in range(1000 if name == 'refit' else 300)]
            field.answered()
            probe.until(lambda calls=storm: all(call.done() for call in calls), 30,
                        f'all answers of {name}')
            assert all(call.result().message for call in storm)
            field.answered()
        assert node.process.poll() is None


def test_faults_of_the_fit_process(recording, model_file):
    with running({**FAST, 'model_file': model_file, 'fit_timeout': 1.0}) as (_, probe):
        field = Range(probe, recording, load_model(model_file))
        for _ in range(200):
            field.good()
            probe.spin(0.004)
        for number, words in ((signal.SIGKILL, 'died (signal 9)'),
                              (signal.SIGSEGV, 'died (signal 11)'),
                              (signal.SIGSTOP, 'the fit hung')):
            probe.until(lambda: probe.values('learning')['fit process'] == 'ready', 60,
                        'a fit process')
            pid = int(probe.values('learning')['fit process id'])
            os.kill(pid, signal.SIGSTOP)
            waiting = probe.ask('refit')
            probe.until(lambda: probe.values('learning')['fit process'] == 'fitting', 60)
            os.kill(pid, number)
            os.kill(pid, signal.SIGCONT if number == signal.SIGSEGV else number)
            probe.until(waiting.done, 60, 'the answer')
            assert not waiting.result().success and words in waiting.result().message
            probe.until(lambda text=words: text in probe.status['learning'].message, 60)
            assert probe.status['learning'].level == b'\x02'
            field.answered()
        # Killed while idle, and once more before it has started again.
        for _ in range(2):
            old = probe.values('learning')['fit process id']
            if old:
                os.kill(int(old), signal.SIGKILL)
            probe.until(lambda was=old: probe.values('learning')['fit process id'] != was, 60)
            field.answered()


def test_a_model_file_of_another_arm(tmp_path, model_file, recording):
    with running({**FAST, 'model_file': model_file, 'joints': '[a, b]'}) as (_, probe):
        status = probe.report('model')
        assert status.level == b'\x02' and 'a, b' in status.message and not probe.torques


def test_killed_while_saving_the_file_is_old_or_new(tmp_path, model_file, recording):
    path = tmp_path / 'model.json'
    path.write_bytes(model_file.read_bytes())
    for round_ in range(3):
        with running({**FAST, 'model_file': path}) as (node, probe):
            assert probe.report('model').level == b'\x00'
            field = Range(probe, recording, load_model(path))
            field.answered()
            for _ in range(20):
                probe.ask('save_model')
            probe.spin(0.002 * (1 + 3 * round_))
            node.process.kill()
        load_model(path)
    folder_full(path, recording)


def folder_full(path, recording):
    """Save into a folder that is gone: that is told, and the file stays as it was."""
    before = path.read_bytes()
    for left in path.parent.glob('.model.json.*'):
        left.unlink()
    with running({**FAST, 'model_file': path}) as (_, probe):
        probe.report('model')
        path.parent.rename(path.parent.with_suffix('.away'))
        answer = probe.call('save_model')
        path.parent.with_suffix('.away').rename(path.parent)
        assert not answer.success and 'nothing was changed' in answer.message
    assert path.read_bytes() == before and len(list(path.parent.iterdir())) == 1
