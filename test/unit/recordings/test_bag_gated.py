"""Slow samples of a bag, with accelerations at the rate of the recording."""

from bench.shared.recordings import messages, write_folder
from gravity_comp_ros.api.read import gated_recording
from gravity_comp_ros.data.gate import GateOptions
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.recordings.bag import ReadOptions
from gravity_comp_ros.recordings.gated_bag import read_gated
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
import numpy as np
import pytest


def bag(path, rate):
    """Write two joints in sines of 0.1 rad/s; return the path."""
    t = np.arange(0.0, 60.0, 1.0 / rate)
    phase = np.column_stack([0.5 * t, 0.4 * t + 1.0])
    q, qd = 0.2 * np.sin(phase), 0.2 * np.array([0.5, 0.4]) * np.cos(phase)
    write_bag(path, [JointTopic('/joint_states', ('a', 'b'), t, q, qd, 5.0 * np.sin(q))])
    return path


def test_accelerations_are_those_of_the_recording(tmp_path):
    result = read_gated(bag(tmp_path / 'x.mcap', 100.0), gate=GateOptions(rate_hz=5.0))
    assert len(result.samples) == 301 and result.report.n_samples == 6000
    assert result.dropped == {'rate': 5699}
    expected = -result.samples.q * np.array([0.5, 0.4]) ** 2
    np.testing.assert_allclose(result.samples.qdd, expected, atol=1e-4)


def test_a_slow_rate_has_no_accelerations(tmp_path):
    assert read_gated(bag(tmp_path / 'x.mcap', 10.0)).samples.qdd is None


def test_no_slow_sample_is_not_an_error(tmp_path):
    result = read_gated(bag(tmp_path / 'x.mcap', 50.0), gate=GateOptions(max_speed=1e-6))
    assert not len(result.samples) and result.samples.qdd.shape == (0, 2)
    assert result.dropped == {'fast': 3000}


def test_a_gate_for_other_joints_is_refused(tmp_path):
    path = write_folder(tmp_path / 'bag', {'/joint_states': messages(20)}, plugin='mcap')
    with pytest.raises(GravityCompError, match='2 values for 3 joints'):
        read_gated(path, gate=GateOptions(max_speed=(1.0, 1.0)))


def test_accelerations_of_bags_with_other_joint_orders(tmp_path):
    """Joints are matched by name, in the order of the first bag, like the samples."""
    first = bag(tmp_path / 'x.mcap', 100.0)
    t = np.arange(0.0, 60.0, 0.01)
    phase = np.column_stack([0.4 * t, 0.5 * t + 2.0])
    q, qd = 0.2 * np.sin(phase), 0.2 * np.array([0.4, 0.5]) * np.cos(phase)
    write_bag(tmp_path / 'y.mcap', [
        JointTopic('/joint_states', ('b', 'a'), t, q, qd, 5.0 * np.sin(q))])
    gate = GateOptions(rate_hz=5.0)
    runs = [read_gated(path, ReadOptions(), gate) for path in (first, tmp_path / 'y.mcap')]
    recording = gated_recording(runs, gate)
    assert runs[1].samples.names == ('b', 'a') and recording.joints == ('a', 'b')
    for joint, rate in (('a', 0.5), ('b', 0.4)):
        n = recording.joints.index(joint)
        np.testing.assert_allclose(recording.slow.qdd[:, n], -rate ** 2 * recording.slow.q[:, n],
                                   atol=1e-4)
