"""Damaged and compressed files, bombs, other formats: refused in one line, or read with a note."""

import io
import shutil
import sqlite3
import struct
import tracemalloc

from bench.shared.recordings import (
    add_other_topic, check_motion, messages, motion, NAMES, write_folder)
from gravity_comp_ros.errors import BagError, GravityCompError
from gravity_comp_ros.recordings import mcap_writer
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.joint_columns import UNDECODABLE
from gravity_comp_ros.recordings.joint_state_cdr import encode
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
from gravity_comp_ros.recordings.messages import (
    CompressionError, decompressed, ZSTD_MAGIC)
import lz4.frame
from mcap.writer import CompressionType, IndexType, Writer
import numpy as np
import pytest
import zstandard

T, Q, QD, TAU = motion()
DEFINITION = 'std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n' \
    'float64[] effort\n'


@pytest.fixture
def mcap(tmp_path, monkeypatch):
    path = tmp_path / 'x.mcap'
    monkeypatch.setattr(mcap_writer, '_CHUNK_BYTES', 2000)
    write_bag(path, [JointTopic('/joint_states', NAMES, T, Q, QD, TAU)])
    return path


@pytest.fixture
def db3(tmp_path):
    (file,) = write_folder(tmp_path / 'bag', {'/joint_states': messages()}).glob('*.db3')
    return file


def refusal(file, path=None, options=ReadOptions()):
    """Return the one line of a refusal that names a file."""
    with pytest.raises(GravityCompError) as error:
        read_bag(path or file, options)
    text = str(error.value)
    assert '\n' not in text and file.name in text
    return text


def read_part(file):
    """Return the number of samples of a damaged file, which are those of the whole one."""
    recording = read_bag(file)
    times = np.rint(50.0 * (recording.samples.t + 1e-9 * recording.report.start_ns
                            - 1_700_000_000)).astype(int)
    np.testing.assert_array_equal(recording.samples.q, Q[times])
    np.testing.assert_array_equal(recording.samples.tau, TAU[times])
    count = len(recording.samples)
    assert f'the {count} readable messages of /joint_states' in recording.report.file_notes[0]
    return count


def test_the_messages_before_the_end_of_a_truncated_mcap_are_read(mcap):
    whole, counts = mcap.read_bytes(), []
    for length in [*range(300, len(whole), 301), *range(len(whole) - 40, len(whole))]:
        mcap.write_bytes(whole[:length])
        try:
            counts.append(read_part(mcap))
        except BagError as error:
            assert 'truncated' in str(error) and '\n' not in str(error) and not counts
    assert counts == sorted(counts) and counts[0] < 20 and counts[-1] == len(T)
    for length in range(40):
        mcap.write_bytes(whole[:length])
        refusal(mcap)


def test_a_damaged_chunk_is_left_out(mcap):
    whole = bytearray(mcap.read_bytes())
    whole[len(whole) // 2:len(whole) // 2 + 500] = bytes(500)
    mcap.write_bytes(whole)
    assert 20 < read_part(mcap) < len(T)


def test_a_wrong_summary_is_not_used(mcap):
    whole = bytearray(mcap.read_bytes())
    place = whole.rindex(b'/joint_states')
    whole[place:place + 13] = b'/other_states'
    mcap.write_bytes(whole)
    assert read_part(mcap) == len(T)


def test_truncated_db3(db3):
    whole = db3.read_bytes()
    for part in (0.01, 0.1):
        db3.write_bytes(whole[:int(part * len(whole))])
        assert 'cannot be read' in refusal(db3) or 'no usable' in refusal(db3)


@pytest.mark.parametrize('has_index', [False, True])
def test_the_rest_of_a_damaged_db3_is_read(tmp_path, has_index):
    # A page contains two dozen messages; recorders of ROS add an index of their times.
    (file,) = write_folder(tmp_path / 'bag', {'/joint_states': messages(1000)}).glob('*.db3')
    base = sqlite3.connect(file)
    base.execute('DROP INDEX IF EXISTS timestamp_idx')
    if has_index:
        base.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
    base.commit()
    base.execute('VACUUM')
    base.close()
    whole, page = file.read_bytes(), 4096
    q = motion(1000)[1]

    def check(data, least, most):
        file.write_bytes(data)
        recording = read_bag(file)
        assert least <= len(recording.samples) < most
        times = np.rint(50.0 * (recording.samples.t + 1e-9 * recording.report.start_ns
                                - 1_700_000_000)).astype(int)
        np.testing.assert_allclose(recording.samples.q, q[times])
        assert 'readable messages of /joint_states are used' in recording.report.file_notes[0]

    damaged, count = bytearray(whole), len(whole) // page
    for number in (count // 4, 3 * count // 4):
        damaged[number * page:(number + 1) * page] = b'\xa5' * page
    check(damaged, 940, 1000)
    check(whole[:(count * 6 // 10) * page], 500, 700)


def test_a_db3_without_its_schema_names_a_tool(db3):
    whole = bytearray(db3.read_bytes())
    whole[100:4096] = b'\xff' * 3996
    db3.write_bytes(whole)
    assert f'`sqlite3 {db3} .recover`' in refusal(db3)


def test_a_db3_with_a_schema_that_is_no_text(db3):
    whole = db3.read_bytes()
    assert whole.count(b'CREATE TABLE messages') == 1
    db3.write_bytes(whole.replace(b'CREATE TABLE messages', b'CREATE TABL\x92 messages'))
    assert 'cannot be read' in refusal(db3)


def test_flipped_bytes_of_a_db3_never_crash(db3):
    whole = db3.read_bytes()
    rng = np.random.default_rng(0)
    for place in rng.integers(16, len(whole), 60):
        damaged = bytearray(whole)
        damaged[place] ^= 255
        db3.write_bytes(damaged)
        try:
            read_bag(db3)
        except GravityCompError as error:
            assert '\n' not in str(error)


def test_invalid_rows_of_a_db3(db3):
    base = sqlite3.connect(db3)
    base.execute("UPDATE messages SET data = 'text' WHERE id = 3")
    base.execute('UPDATE messages SET data = 3.5 WHERE id = 4')
    base.commit()
    base.close()
    assert dict(read_bag(db3).report.dropped) == {'not decodable': 2}


def test_a_database_without_recording(tmp_path):
    path = tmp_path / 'x.db3'
    base = sqlite3.connect(path)
    base.execute('CREATE TABLE songs (name TEXT)')
    base.commit()
    base.close()
    assert 'not a recording' in refusal(path)


@pytest.mark.parametrize(('content', 'message'), [
    (b'', 'empty'), (b'hello', 'neither an MCAP nor'), (b'#ROSBAG V2.0\n', 'ROS 1'),
    (b'\x28\xb5\x2f\xfd junk', 'cannot be decompressed'),
    (b'\x89MCAP0\r\n', 'truncated'), (b'SQLite format 3\0' + bytes(200), 'cannot be read')])
def test_not_a_recording(tmp_path, content, message):
    path = tmp_path / 'x.mcap'
    path.write_bytes(content)
    assert message in refusal(path)


def test_missing_recordings(tmp_path):
    assert 'no such recording' in refusal(tmp_path / 'none.mcap')
    (tmp_path / 'folder').mkdir()
    assert 'no .mcap or .db3 file' in refusal(tmp_path / 'folder')
    for name in ('morning', 'evening'):
        (source,) = write_folder(tmp_path / name, {'/joint_states': messages()}).glob('*.db3')
        shutil.copy(source, tmp_path / 'folder' / f'{name}_0.db3')
    assert 'name one of evening_0.db3, morning_0.db3' in refusal(tmp_path / 'folder')


def test_recordings_without_joint_states(tmp_path):
    path = add_other_topic(tmp_path / 'chat')
    assert 'it has /chatter (std_msgs/msg/String)' in refusal(path)
    other = tmp_path / 'x.mcap'
    with other.open('wb') as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema('sensor_msgs/msg/JointState', 'protobuf', b'')
        writer.register_channel('/joint_states', 'protobuf', schema)
        writer.finish()
    assert 'has /joint_states (sensor_msgs/msg/JointState in protobuf)' in refusal(other)
    text = refusal(path, options=ReadOptions(topic='/chatter'))
    assert 'topic /chatter is a std_msgs/msg/String' in text


def test_empty_recordings(tmp_path):
    assert 'empty: it has no topics' in refusal(write_folder(tmp_path / 'bag', {}))
    path = tmp_path / 'x.mcap'
    write_bag(path, [])
    assert 'empty: it has no topics' in refusal(path)
    nothing = np.empty((0, 3))
    write_bag(path, [JointTopic('/joint_states', NAMES, np.empty(0), nothing, nothing, nothing)])
    assert 'has no messages' in refusal(path)


def test_metadata_that_names_a_missing_file(tmp_path):
    folder = write_folder(tmp_path / 'bag', {'/joint_states': messages()})
    (file,) = folder.glob('*.db3')
    file.rename(folder / 'renamed.db3')
    text = refusal(folder)
    assert file.name in text and 'there is renamed.db3' in text
    (folder / 'renamed.db3').unlink()
    assert file.name in refusal(folder)


@pytest.mark.parametrize('content', [
    'hello', '', '[1, 2', 'rosbag2_bagfile_information: {}', '\0',
    'rosbag2_bagfile_information: {relative_file_paths: [1]}',
    'rosbag2_bagfile_information: {relative_file_paths: []}',
    '!!python/object/apply:os.system ["true"]'])
def test_files_are_read_without_damaged_metadata(tmp_path, content):
    folder = write_folder(tmp_path / 'bag', {'/joint_states': messages()})
    (folder / 'metadata.yaml').write_text(content)
    check_motion(read_bag(folder))


def test_metadata_cannot_reach_outside_its_folder(tmp_path):
    folder = write_folder(tmp_path / 'bag', {'/joint_states': messages()})
    (file,) = folder.glob('*.db3')
    file.rename(tmp_path / 'secret.db3')
    text = (folder / 'metadata.yaml').read_text().replace(file.name, '../secret.db3')
    (folder / 'metadata.yaml').write_text(text)
    assert 'secret.db3' in refusal(folder)


@pytest.mark.parametrize('plugin', ['sqlite3', 'mcap'])
def test_compressed_messages_without_metadata(tmp_path, plugin):
    path = write_folder(tmp_path / 'bag', {'/joint_states': messages()}, plugin, 8, 'MESSAGE')
    (path / 'metadata.yaml').unlink()
    check_motion(read_bag(path))


def test_the_messages_of_a_truncated_compressed_file_are_read(tmp_path):
    path = write_folder(tmp_path / 'bag', {'/joint_states': messages(3000)}, 'sqlite3', 8, 'FILE')
    (file,) = path.glob('*.zstd')
    whole, counts = file.read_bytes(), []
    for share in (0.3, 0.7, 0.99):
        file.write_bytes(whole[:int(share * len(whole))])
        report = read_bag(path).report
        assert report.file_notes[0].startswith(f'{file.name} is damaged')
        counts.append(report.n_samples)
    assert 500 < counts[0] < counts[1] < counts[2] < 3000


def test_a_damaged_file_inside_a_compressed_one_is_named_as_that(tmp_path):
    for content in (b'SQLite format 3\0' + bytes(200), b'\x89MCAP0\r\n', b'hello'):
        file = tmp_path / 'x.db3.zstd'
        file.write_bytes(zstandard.compress(content))
        assert 'gravity_comp_' not in refusal(file)


def bomb(kind, size=60_000_000):
    if kind == 'lz4':
        return lz4.frame.compress(bytes(size), store_size=False)
    out = io.BytesIO()
    with zstandard.ZstdCompressor(write_content_size=False).stream_writer(
            out, closefd=False) as writer:
        writer.write(bytes(size))
    return out.getvalue()


@pytest.mark.parametrize('kind', ['zstd', 'lz4'])
def test_nothing_is_expanded_beyond_the_limit(kind):
    data = bomb(kind)
    tracemalloc.start()
    try:
        with pytest.raises(CompressionError, match='expands to more than 1000 bytes'):
            decompressed(data, kind, 1000)
        # Nor is memory used for it.
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()
    assert decompressed(bomb(kind, 1000), kind, 1000) == bytes(1000)


@pytest.mark.parametrize('indexed', [True, False])
@pytest.mark.parametrize('kind', ['zstd', 'lz4'])
def test_a_chunk_that_expands_beyond_its_size_is_refused(tmp_path, kind, indexed):
    path = tmp_path / 'x.mcap'
    compression = CompressionType.ZSTD if kind == 'zstd' else CompressionType.LZ4
    with path.open('wb') as stream:
        writer = Writer(stream, compression=compression, enable_crcs=False,
                        index_types=IndexType.ALL if indexed else IndexType.NONE)
        writer.start('ros2', '')
        schema = writer.register_schema('sensor_msgs/msg/JointState', 'ros2msg', b'x')
        channel = writer.register_channel('/joint_states', 'cdr', schema)
        writer.add_message(channel, 1, bytes(50_000_000), 1, 0)
        writer.finish()
    data = bytearray(path.read_bytes())
    # The size of a chunk follows its times; 10 bytes are declared.
    at = data.index(struct.pack('<QQ', 1, 1)) + 16
    data[at:at + 8] = struct.pack('<Q', 10)
    path.write_bytes(data)
    with pytest.raises(BagError, match='damaged|expands'):
        read_bag(path)


def test_a_compressed_message_that_is_a_bomb_is_refused(tmp_path):
    rows = messages()
    rows[0][1] = bomb('zstd')
    with pytest.raises(BagError, match='a message on /joint_states cannot be decompressed: it'):
        read_bag(write_folder(tmp_path / 'bag', {'/joint_states': rows}))


def test_a_damaged_compressed_message_is_left_out(tmp_path):
    rows = [[ns, zstandard.ZstdCompressor().compress(encode(**content))]
            for ns, content in messages()]
    rows[7][1] = ZSTD_MAGIC + b' junk'
    report = read_bag(write_folder(tmp_path / 'bag', {'/joint_states': rows})).report
    assert report.n_samples == 49 and report.dropped == {UNDECODABLE: 1}
    assert report.file_notes == ('1 message cannot be decompressed',)


def ros1(number, stamp, q, qd, tau):
    raw = struct.pack('<IIII', number, stamp // 10**9, stamp % 10**9, 5) + b'world'
    raw += struct.pack('<I', len(NAMES))
    for name in NAMES:
        raw += struct.pack('<I', len(name)) + name.encode()
    for values in (q, qd, tau):
        raw += struct.pack('<I', len(values)) + np.asarray(values, '<f8').tobytes()
    return raw


@pytest.mark.parametrize('velocity', [True, False])
def test_ros1_in_mcap(tmp_path, velocity):
    path = tmp_path / 'x.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros1', '')
        schema = writer.register_schema('sensor_msgs/JointState', 'ros1msg', DEFINITION.encode())
        channel = writer.register_channel('/joint_states', 'ros1', schema)
        for k, t in enumerate(T):
            stamp = 1_700_000_000 * 10**9 + round(t * 1e9)
            writer.add_message(channel, stamp, ros1(
                k, stamp, Q[k], QD[k] if velocity else (), TAU[k]), stamp, k)
        writer.finish()
    recording = read_bag(path)
    assert recording.samples.names == NAMES
    np.testing.assert_array_equal(recording.samples.tau, TAU)
    assert recording.report.velocity == ('measured' if velocity else 'differentiated')
