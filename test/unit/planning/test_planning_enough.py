"""Sufficiency of the motion of recordings for gravity, and the motion that they lack."""

from dataclasses import replace
import json

from bench.shared.serial_arms import parallel_axis_arm
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.facts.fact import Kind
from gravity_comp_ros.planning.enough import enough_motion
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

ARM = parallel_axis_arm()
RATE = 10.0
CENTRE = np.array([0.2, -0.9, 0.8, -0.5, 0.7, 0.1])
PERIODS = np.array([61.0, 43.0, 29.0, 37.0, 53.0, 47.0])


def recorded(q):
    """Return samples along q (M, N) at 10 Hz, with friction and noise."""
    t = np.arange(len(q)) / RATE
    qd = np.gradient(q, t, axis=0)
    friction = np.array([2.0, 3.0, 2.0, 1.0, 0.8, 0.5])
    tau = gravity_torque(ARM, q) + friction * np.tanh(qd / 0.004)
    tau += 0.1 * np.random.default_rng(0).standard_normal(q.shape)
    return JointSamples.single_run(ARM.joints, t, q, qd, tau)


def sines(amplitude=0.7, seconds=180, periods=PERIODS):
    """Return poses (M, 6): sines of another period on each joint."""
    t = np.arange(int(seconds * RATE)) / RATE
    return CENTRE + amplitude * np.sin(2 * np.pi * t[:, None] / periods + np.arange(6))


def test_enough():
    enough = enough_motion(recorded(sines()))
    assert enough.facts() == [] and enough.seconds == 0
    assert enough.directions == enough.moving == 6
    assert enough.std == enough.after and max(enough.std.values()) < 0.05
    # A short recording is named with its duration.
    enough = enough_motion(recorded(sines(seconds=15)))
    assert len(enough.facts()) >= 1 and enough.seconds >= 15
    assert max(enough.std.values()) > 0.05


def test_a_joint_that_hardly_moves_is_named_with_a_motion_that_is_enough():
    amplitude = np.array([0.7, 0.04, 0.7, 0.7, 0.7, 0.7])
    first = recorded(sines(amplitude))
    enough = enough_motion(first)
    (fact,) = enough.facts()
    assert fact.kind is Kind.MOTION and ARM.joints[1] in fact.joints
    assert max(enough.after.values()) <= 0.05 < enough.std[ARM.joints[1]]
    assert f'record {enough.seconds:.0f} s more' in fact.sentence
    assert [sweep.joint for sweep in enough.sweeps] == [ARM.joints[1]] and not enough.together
    # The motion of the advice, at a pose of the recording.
    sweep = enough.sweeps[0]
    assert sweep.high - sweep.low == pytest.approx(1.0)
    t = np.arange(int(sweep.seconds * RATE)) / RATE
    period = 2 * (sweep.high - sweep.low) / 0.1
    q = np.repeat(first.q[400:401], len(t), axis=0)
    q[:, 1] = sweep.low + (sweep.high - sweep.low) * np.abs((2 * t / period + 1) % 2 - 1)
    assert enough_motion(concatenate([first, recorded(q)])).facts() == []


@pytest.mark.parametrize('count', [2, 12])
def test_offsets_that_differ_between_recordings_are_no_lack_of_motion(count):
    runs = [recorded(q) for q in np.split(sines(), count)]
    offsets = 10.0 * np.random.default_rng(1).standard_normal((count, len(ARM.joints)))
    shifted = concatenate([replace(r, tau=r.tau + own) for r, own in zip(runs, offsets)])
    assert enough_motion(shifted).facts() == [] == enough_motion(concatenate(runs)).facts()


def test_offsets_that_differ_are_uncertain_where_the_pose_differs_with_them():
    """A shoulder at another angle in each of six recordings, with another offset."""
    runs = []
    for angle in np.linspace(-0.7, 0.7, 6):
        q = sines(seconds=60)
        q[:, 1] = CENTRE[1] + angle
        runs.append(recorded(q))
    assert enough_motion(concatenate(runs)).facts() == []
    own = np.random.default_rng(1).normal(0, 10.0, (6, 1)) * np.eye(6)[1]
    enough = enough_motion(concatenate([replace(r, tau=r.tau + o) for r, o in zip(runs, own)]))
    assert list(enough.facts()[0].joints) == [ARM.joints[1]]


def test_joints_that_follow_others_are_named():
    # Angles are combinations of two sines, each with its own shares of them.
    t = np.arange(1800) / RATE
    two = np.stack([np.sin(2 * np.pi * t / 41), np.sin(2 * np.pi * t / 67)], axis=1)
    shares = np.random.default_rng(3).uniform(0.3, 0.6, (2, 6)) * [[1, -1, 1, 1, -1, 1]]
    enough = enough_motion(recorded(CENTRE + two @ shares))
    assert enough.directions == 2 and set(enough.dependent) == set(ARM.joints)
    assert 'span 2 directions' in enough.facts()[0].sentence
    one = sines()
    one[:, 4] = one[:, 1]
    enough = enough_motion(recorded(one))
    assert enough.dependent == (ARM.joints[1], ARM.joints[4]) and enough.directions == 5


def test_unusable():
    q = sines()
    with pytest.raises(FitError):
        enough_motion(recorded(q[:20]))
    with pytest.raises(FitError):
        enough_motion(recorded(np.repeat(q[:1], 100, axis=0)))


def test_info_prints_it_once_for_all_recordings(tmp_path, capsys):
    paths = []
    for k, amplitude in enumerate(([0.7, 0.0, 0.7, 0.7, 0.7, 0.7],
                                   [0.0, 0.6, 0.4, 0.0, 0.3, 0.0])):
        samples = recorded(sines(np.array(amplitude), 120 - 60 * k))
        paths.append(tmp_path / f'{k}.mcap')
        write_bag(paths[-1], [joint_states(samples)])
    assert main(['info', str(paths[0])]) == 0
    assert 'too little motion for a model' in ' '.join(capsys.readouterr().out.split())
    assert main(['info', *map(str, paths), '--json']) == 0
    motion = json.loads(capsys.readouterr().out)['motion']
    assert motion['seconds'] == 0 and not motion['sweeps'] and not motion['dependent']
    assert main(['info', str(paths[0]), '--json', '--effort-scale',
                 ','.join(f'{name}=1e-6' for name in ARM.joints)]) == 0
    assert json.loads(capsys.readouterr().out)['motion'] is None
