"""Written MCAP files, as read by the mcap library and by rosbags."""

import os
from pathlib import Path
import shlex
import subprocess

from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import concatenate, JointSamples
from gravity_comp_ros.errors import BagError, OptionError
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.joint_state_cdr import JOINT_STATE_DEFINITION
from gravity_comp_ros.recordings.mcap_writer import (
    DEFAULT_START_NS, joint_states, JointTopic, write_bag)
from mcap.reader import make_reader
import numpy as np
import pytest
from rosbags.highlevel import AnyReader

NAMES = ('a', 'b')
T = np.array([0.0, 0.1, 0.2])
Q = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])


def topics():
    return [JointTopic('/joint_states', NAMES, T, Q, 10 * Q, -Q),
            JointTopic('/extra', NAMES, T + 0.05, effort=Q)]


def test_mcap_library_reads_it(tmp_path):
    path = tmp_path / 'x.mcap'
    assert write_bag(path, topics(), metadata={'made': {'by': 'x', 'n': 3}}) == 6
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        assert summary.statistics.message_count == 6
        assert {chunk.compression for chunk in summary.chunk_indexes} == {'zstd'}
        assert [record.metadata for record in reader.iter_metadata()] == [{'by': 'x', 'n': '3'}]
        (schema,) = summary.schemas.values()
        assert (schema.name, schema.encoding) == ('sensor_msgs/msg/JointState', 'ros2msg')
        assert schema.data.decode() == JOINT_STATE_DEFINITION
        seen = [(channel.topic, message.log_time, message.publish_time, message.sequence)
                for _, channel, message in reader.iter_messages(log_time_order=False)]
    assert [topic for topic, *_ in seen] == ['/joint_states', '/extra'] * 3
    assert [log - DEFAULT_START_NS for _, log, _, _ in seen] == [k * 50_000_000 for k in range(6)]
    assert all(log == published for _, log, published, _ in seen)
    assert [number for *_, number in seen] == [0, 0, 1, 1, 2, 2]


def test_rosbags_reads_names_stamps_and_values(tmp_path):
    path, again = tmp_path / 'x.mcap', tmp_path / 'again.mcap'
    write_bag(path, topics())
    write_bag(again, topics())
    assert path.read_bytes() == again.read_bytes()
    with AnyReader([path]) as reader:
        result = {}
        for connection, log_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            assert stamp == log_ns
            result.setdefault(connection.topic, []).append(message)
    assert [m.name for m in result['/joint_states']] == [['a', 'b']] * 3
    np.testing.assert_array_equal([m.position for m in result['/joint_states']], Q)
    np.testing.assert_array_equal([m.velocity for m in result['/joint_states']], 10 * Q)
    np.testing.assert_array_equal([m.effort for m in result['/joint_states']], -Q)
    np.testing.assert_array_equal([m.effort for m in result['/extra']], Q)
    assert [m.position.size for m in result['/extra']] == [0, 0, 0]


def test_empty_topic_and_nan_are_written_as_they_are(tmp_path):
    path = tmp_path / 'x.mcap'
    nothing = np.empty((0, 1))
    write_bag(path, [JointTopic('/none', ('a',), np.empty(0), nothing),
                     JointTopic('/nan', ('a',), T, effort=np.full((3, 1), np.nan))])
    with AnyReader([path]) as reader:
        efforts = [reader.deserialize(raw, c.msgtype).effort for c, _, raw in reader.messages()]
    assert np.isnan(efforts).all() and len(efforts) == 3


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(BagError) as error:
        write_bag(tmp_path / 'none' / 'x.mcap', topics())
    assert 'x.mcap' in str(error.value) and '\n' not in str(error.value)


def test_a_topic_requires_a_single_run():
    one = JointSamples.single_run(NAMES, T, Q, Q, Q)
    topic = joint_states(one)
    assert topic.name == '/joint_states' and topic.joints == NAMES
    with pytest.raises(OptionError, match='one bag per run'):
        joint_states(concatenate([one, one]))


@pytest.mark.parametrize('make', [
    lambda path: JointTopic('no_slash', NAMES, T, Q),
    lambda path: JointTopic('/x', NAMES, T, Q[:, :1]),
    lambda path: JointTopic('/x', NAMES, T, effort=Q[:2]),
    lambda path: write_bag(path, topics(), -1),
    lambda path: write_bag(path, [JointTopic('/x', NAMES, -1e10 * T[::-1], Q)]),
    lambda path: write_bag(path, [JointTopic('/x', NAMES, T[::-1], Q)]),
    lambda path: write_bag(path, [JointTopic('/x', NAMES, np.array([0, np.nan, 1]), Q)]),
    lambda path: write_bag(path, topics() + topics())])
def test_wrong_calls_are_refused_and_write_nothing(tmp_path, make):
    with pytest.raises(OptionError):
        make(tmp_path / 'x.mcap')
    assert not list(tmp_path.iterdir())


BAGS = Path(__file__).resolve().parents[3] / 'bags'
FILES = sorted(path.name for path in BAGS.glob('*.mcap'))


@pytest.fixture(scope='module')
def remade(tmp_path_factory):
    """Return a folder with the bags of the commands that the script runs."""
    folder = tmp_path_factory.mktemp('bags')
    done = subprocess.run([str(BAGS / 'make.sh'), str(folder)], check=True, text=True,
                          capture_output=True, env={**os.environ, 'GRAVITY_COMP': 'echo'})
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for line in done.stdout.splitlines():
            assert main(shlex.split(line)) == 0
    return folder


def test_the_script_makes_all_bags(remade):
    assert len(FILES) == 5
    assert sorted(path.name for path in remade.iterdir()) == FILES


@pytest.mark.parametrize('name', FILES)
def test_same_samples_when_made_again(remade, name):
    kept, again = read_bag(BAGS / name), read_bag(remade / name)
    assert kept.samples.names == again.samples.names
    assert kept.report.start_ns == again.report.start_ns
    for field in ('t', 'q', 'qd', 'tau'):
        # Rounding depends on the version of the rigid-body library.
        np.testing.assert_allclose(getattr(kept.samples, field), getattr(again.samples, field),
                                   rtol=1e-9, atol=1e-9)


def test_readme_has_the_commands_of_the_script():
    script = [line.split(' ', 1)[1] for line in (BAGS / 'make.sh').read_text().splitlines()
              if line.startswith('$comp ')]
    readme = (BAGS / 'README.md').read_text()
    assert len(script) == 5
    for arguments in script:
        assert f'`gravity_comp {arguments}`' in readme
