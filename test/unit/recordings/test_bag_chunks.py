"""Chunks, batches and single messages: against the mcap package, rosbags, and each other."""

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.joint_state_cdr import (
    decode, encode, JOINT_STATE, JOINT_STATE_DEFINITION, JOINT_STATE_HASH)
from gravity_comp_ros.recordings.mcap_storage import McapStorage
from gravity_comp_ros.recordings.messages import Batch, batched
from hypothesis import example, given, HealthCheck, settings, strategies as st
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores

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
        return [(int(stamp), batch.message(m)) for batch in storage.batches(TOPICS[0])
                for m, stamp in enumerate(batch.log_ns)]
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


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
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
def test_flipped_bytes_never_change_messages(tmp_path, compression):
    path = write(tmp_path / 'x.mcap', [(k, k % 3) for k in range(100)], chunk_size=2000,
                 compression=compression)
    whole, good = path.read_bytes(), read(path)
    rng, damaged = np.random.default_rng(0), 0
    for place in rng.integers(8, len(whole) - 8, 40):
        raw = bytearray(whole)
        raw[place] ^= int(rng.integers(1, 256))
        path.write_bytes(raw)
        try:
            result = read(path)
        except BagError as error:
            assert '\n' not in str(error)
            damaged += 1
            continue
        # Those of a damaged chunk are left out.
        assert set(result) <= set(good)
        damaged += len(result) < len(good)
    assert damaged > 10


STORE = get_typestore(Stores.ROS2_JAZZY)
Header = STORE.types['std_msgs/msg/Header']
Time = STORE.types['builtin_interfaces/msg/Time']
JointState = STORE.types[JOINT_STATE]

SENDERS = (
    {'names': ['a', 'bb', 'ccc']}, {'names': ['ccc', 'bb', 'a']},
    {'names': ['a', 'bb', 'ccc'], 'frame_id': 'base'},
    {'names': ['a', 'bb', 'ccc'], 'frame_id': 'tool'}, {'names': ['a', 'bb', 'ccd']},
    {'names': ['a', 'bb', 'ccc'], 'velocity': ()},
    {'names': ['a', 'bb', 'ccc'], 'effort': (), 'velocity': ()},
    {'names': ['a', 'bb', 'ccc'], 'position': ()},
    {'names': ['grip']}, {'names': []}, {'names': ['größe', '']},
    *({'names': [f'j{k}']} for k in range(40)))


def batches_of(messages, rng):
    """Return encoded messages in two batches, with other bytes between some of them."""
    middle = int(rng.integers(len(messages) + 1))
    for first, part in ((0, messages[:middle]), (middle, messages[middle:])):
        gaps = [bytes(int(rng.integers(0, 3) * rng.integers(0, 9))) for _ in part]
        data = b''.join(gap + raw for gap, raw in zip(gaps, part))
        length = np.array([len(raw) for raw in part], dtype=int)
        ends = np.cumsum(length + [len(gap) for gap in gaps]) if part else length
        yield Batch(np.frombuffer(data, dtype=np.uint8), ends - length, length,
                    np.arange(first, first + len(part), dtype=np.uint64))


@given(st.lists(st.sampled_from(SENDERS), max_size=60), st.sampled_from([0.0, 0.1, 0.5]),
       st.integers(0, 10 ** 6))
@example(list(SENDERS[11:]) * 3, 0.0, 0)
def test_each_message_of_several_senders_is_decoded_as_by_rosbags(senders, spoilt, seed):
    """A message that is cut or of another byte order does not affect the others."""
    rng, encoded, expected = np.random.default_rng(seed), [], {}
    for number, sender in enumerate(senders):
        fields = {kind: rng.normal(size=len(sender['names']))
                  for kind in ('position', 'velocity', 'effort')}
        raw = encode(number, **{**fields, **sender})
        if rng.random() >= spoilt:
            expected[number] = STORE.deserialize_cdr(raw, JOINT_STATE)
        elif rng.random() < 0.5:
            raw = raw[:rng.integers(len(raw))]
        else:
            raw = bytes([raw[0], raw[1] ^ 1]) + raw[2:]
        encoded.append(raw)
    decoded = {}
    for batch in batches_of(encoded, rng):
        for block in decode(batch):
            for row, which in enumerate(block.which):
                assert int(batch.log_ns[which]) not in decoded
                decoded[int(batch.log_ns[which])] = block, row
    assert expected.keys() <= decoded.keys()
    for number, message in expected.items():
        block, row = decoded[number]
        assert (list(block.names), int(block.stamp_ns[row])) == (message.name, number)
        for kind in ('position', 'velocity', 'effort'):
            values = getattr(block, kind)[row]
            assert values.dtype == np.float64
            np.testing.assert_array_equal(values, getattr(message, kind))


floats = st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=9)
names = st.lists(st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=20),
                 max_size=9)
messages = st.tuples(st.integers(0, 2**31 * 10**9 - 1), names, floats, floats, floats,
                     st.text('abcdefgh', max_size=9))


def rosbags_message(stamp, joints, position, velocity, effort, frame):
    header = Header(stamp=Time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=frame)
    arrays = (np.array(x, dtype=float) for x in (position, velocity, effort))
    return JointState(header, joints, *arrays)


def decoded_alone(raw):
    """Return the block of a single message, None if it cannot be decoded."""
    (batch,) = batched(iter([(0, raw)]))
    return next(decode(batch), None)


@given(messages, st.booleans())
def test_we_decode_messages_of_rosbags(message, little):
    raw = STORE.serialize_cdr(rosbags_message(*message), JOINT_STATE, little_endian=little)
    decoded = decoded_alone(bytes(raw))
    assert (decoded.stamp_ns[0], decoded.names) == (message[0], tuple(message[1]))
    for values, expected in zip((decoded.position, decoded.velocity, decoded.effort),
                                message[2:5]):
        np.testing.assert_array_equal(values[0], expected)


@given(messages, st.data())
def test_damaged_bytes_are_refused_or_read_but_never_crash(message, data):
    raw = bytearray(encode(*message))
    cut = data.draw(st.integers(0, len(raw)))
    place = data.draw(st.integers(0, len(raw) - 1))
    raw[place] = data.draw(st.integers(0, 255))
    decoded = decoded_alone(bytes(raw[:cut]))
    assert decoded is None or decoded.position.size <= len(raw)


def test_every_cut_of_a_message_and_other_encodings_are_refused():
    raw = encode(5, ['a', 'bc'], [1, 2], [3, 4], [5, 6])
    assert decoded_alone(raw).names == ('a', 'bc')
    assert all(decoded_alone(raw[:length]) is None for length in range(len(raw)))
    assert all(decoded_alone(bytes([0, kind]) + raw[2:]) is None for kind in (2, 3, 6, 7, 255))


def test_definition_and_hash_are_those_of_the_type():
    ours = [line for line in JOINT_STATE_DEFINITION.splitlines() if line]
    printed = STORE.generate_msgdef(JOINT_STATE, ros_version=2)[0]
    assert ours == [line for line in printed.splitlines() if line]
    assert STORE.hash_rihs01(JOINT_STATE) == JOINT_STATE_HASH
