"""
Faults of the input: no message causes a wrong torque.

After each fault every torque is that of the model at the pose of its message, the next valid
message is answered, and the status `input` counts the fault by its reason.
"""

from pathlib import Path

from bench.shared.node_messages import joint_state, send_message
from gravity_comp_ros.node.diagnostics import WARN
from gravity_comp_ros.node.node_core import NodeCore
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.recordings.bag import read_bag
import numpy as np
import pytest

NAMES = [f'iiwa_joint_{k}' for k in range(1, 8)]
NAN, INF = float('nan'), float('inf')
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


def shuffled(message):
    """Return the positions of a message alone, in another order, with unknown joints."""
    order = [3, 0, 6, 1, 5, 2, 4]
    message.name = ['gripper', *(NAMES[k] for k in order), 'wheel']
    message.position = [9.0, *(message.position[k] for k in order), NAN]
    message.velocity = message.effort = []
    return message


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


def test_positions_alone_in_another_order_with_unknown_joints_are_answered(field):
    assert field.send(shuffled(field.message()))


@pytest.mark.parametrize('shift, reason', [(0.0, 'time_still'), (-0.5, 'time_back'),
                                           (-900.0, 'time_back'), (None, 'time_back')])
def test_an_equal_earlier_or_missing_stamp_is_dropped(field, shift, reason):
    before, last = field.count(reason), field.t
    assert not field.send(field.message(t=0.0 if shift is None else last + shift))
    assert field.count(reason) == before + 1 and field.send(field.message())


@pytest.mark.parametrize('seconds', [-500.0, -9000.0])
def test_a_clock_that_is_set_back_is_accepted(field, seconds):
    before, field.t = field.count('clock_jump'), field.t + seconds
    answered = [field.send(field.message()) for _ in range(6)]
    assert answered == [False] * 4 + [True] * 2 and field.count('clock_jump') == before + 1
