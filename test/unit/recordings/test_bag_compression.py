"""Compressed and damaged recordings: without metadata, truncated, of ROS 1, and bombs."""

import io
import struct
import tracemalloc

from bench.shared.recordings import messages, motion, NAMES, write_folder
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.compression import (
    CompressionError, decompressed, ZSTD_MAGIC)
from gravity_comp_ros.recordings.joint_columns import UNDECODABLE
from gravity_comp_ros.recordings.joint_state_cdr import encode
import lz4.frame
from mcap.writer import CompressionType, IndexType, Writer
import numpy as np
import pytest
import zstandard

T, Q, QD, TAU = motion()
DEFINITION = 'std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n' \
    'float64[] effort\n'


def check(recording):
    np.testing.assert_allclose(recording.samples.t, T, atol=1e-9)
    for name, values in (('q', Q), ('qd', QD), ('tau', TAU)):
        np.testing.assert_array_equal(getattr(recording.samples, name), values)


@pytest.mark.parametrize('plugin', ['sqlite3', 'mcap'])
def test_compressed_messages_without_metadata(tmp_path, plugin):
    path = write_folder(tmp_path / 'bag', {'/joint_states': messages()}, plugin, 8, 'MESSAGE')
    (path / 'metadata.yaml').unlink()
    check(read_bag(path))


@pytest.mark.parametrize('share', [0.3, 0.7, 0.99])
def test_a_truncated_file_is_named_itself(tmp_path, share):
    path = write_folder(tmp_path / 'bag', {'/joint_states': messages(3000)}, 'sqlite3', 8, 'FILE')
    (file,) = path.glob('*.zstd')
    whole = file.read_bytes()
    file.write_bytes(whole[:int(share * len(whole))])
    with pytest.raises(BagError) as error:
        read_bag(path)
    assert f'{file} is truncated: its compressed data end after' in str(error.value)
    assert 'gravity_comp_' not in str(error.value)


def test_a_damaged_file_inside_a_compressed_one_is_named_as_that(tmp_path):
    for content in (b'SQLite format 3\0' + bytes(200), b'\x89MCAP0\r\n', b'hello'):
        file = tmp_path / 'x.db3.zstd'
        file.write_bytes(zstandard.compress(content))
        with pytest.raises(BagError) as error:
            read_bag(file)
        assert str(file) in str(error.value) and 'gravity_comp_' not in str(error.value)


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
