"""Chunk-wise reading of MCAP files, against the reader of the mcap package."""

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.joint_state_cdr import encode, JOINT_STATE, JOINT_STATE_DEFINITION
from gravity_comp_ros.recordings.mcap_storage import McapStorage
from hypothesis import given, HealthCheck, settings, strategies as st
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
import numpy as np
import pytest

TOPICS = ('/joint_states', '/other', '/joint_states')   # the first topic has two channels


def write(path, events, **options):
    """Write (log time, channel number) events; the stamp is the index of the event."""
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start(profile='ros2', library='test')
        schema = writer.register_schema(JOINT_STATE, 'ros2msg', JOINT_STATE_DEFINITION.encode())
        channels = [writer.register_channel(topic, 'cdr', schema) for topic in TOPICS]
        for number, (time, channel) in enumerate(events):
            data = encode(number, ['a'] * (1 + channel), [1.0] * (1 + channel))
            writer.add_message(channels[channel], time, data, time, number)
        writer.finish()
    return path


def read(path):
    """Return log time and bytes of the messages of the first topic."""
    storage = McapStorage(path)
    try:
        return list(storage.messages(TOPICS[0]))
    finally:
        storage.close()


def by_mcap(path):
    """Return the same from the reader of the mcap package, in the order of the file."""
    with path.open('rb') as stream:
        channels, messages = {}, []
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Channel):
                channels[record.id] = record.topic
            elif isinstance(record, Message) and channels[record.channel_id] == TOPICS[0]:
                messages.append((record.log_time, record.data))
    return messages


@st.composite
def recordings(draw):
    """Draw sorted, nearly sorted or unsorted events, and options of the writer."""
    rng = np.random.default_rng(draw(st.integers(0, 10 ** 6)))
    count = draw(st.integers(0, 80))
    times = np.cumsum(rng.integers(0, 4, count)) + draw(
        st.sampled_from([0, 3, 200])) * rng.integers(0, 2, count)
    channels = rng.integers(0, draw(st.integers(1, 3)), count)
    return list(zip(times.tolist(), channels.tolist())), {
        'compression': draw(st.sampled_from([CompressionType.NONE, CompressionType.ZSTD,
                                             CompressionType.LZ4])),
        'chunk_size': draw(st.sampled_from([1, 300, 2000, 10 ** 6])),
        'enable_crcs': draw(st.booleans()),
        'index_types': draw(st.sampled_from([
            IndexType.ALL, IndexType.NONE, IndexType.ALL & ~IndexType.MESSAGE])),
        'use_chunking': draw(st.sampled_from([True, True, True, False])),
        'repeat_channels': True,
        'use_summary_offsets': draw(st.booleans())}


@settings(max_examples=150,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(recordings())
def test_messages_and_order_agree_with_mcap(tmp_path, recording):
    events, options = recording
    path = write(tmp_path / 'x.mcap', events, **options)
    result = read(path)
    assert result == by_mcap(path)
    assert len(result) == sum(channel != 1 for _, channel in events)


def test_a_chunk_is_one_batch(tmp_path):
    storage = McapStorage(write(tmp_path / 'x.mcap', [(k, k % 2) for k in range(1000)],
                                chunk_size=20000))
    assert 2 <= len(list(storage.batches(TOPICS[0]))) <= 10
    storage.close()


@pytest.mark.parametrize('compression', [CompressionType.NONE, CompressionType.ZSTD,
                                         CompressionType.LZ4])
@pytest.mark.parametrize('seed', range(3))
def test_flipped_bytes_never_change_messages(tmp_path, compression, seed):
    path = write(tmp_path / 'x.mcap', [(k, k % 3) for k in range(100)], chunk_size=2000,
                 compression=compression)
    whole, good = path.read_bytes(), read(path)
    rng, refused = np.random.default_rng(seed), 0
    for place in rng.integers(8, len(whole) - 8, 40):
        raw = bytearray(whole)
        raw[place] ^= int(rng.integers(1, 256))
        path.write_bytes(raw)
        try:
            result = read(path)
        except BagError as error:
            assert '\n' not in str(error)
            refused += 1
            continue
        assert result == good
    assert refused > 15
