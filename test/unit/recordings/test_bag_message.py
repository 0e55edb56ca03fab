"""CDR encoding of JointState, against the serialiser of rosbags and with damaged bytes."""

from gravity_comp_ros.recordings.joint_state_cdr import (
    encode, JOINT_STATE, JOINT_STATE_DEFINITION, JOINT_STATE_HASH)
from gravity_comp_ros.recordings.message_layout import LayoutDecoder
from gravity_comp_ros.recordings.messages import batched
from hypothesis import example, given, strategies as st
import numpy as np
from rosbags.typesys import get_typestore, Stores

STORE = get_typestore(Stores.ROS2_JAZZY)
Header = STORE.types['std_msgs/msg/Header']
Time = STORE.types['builtin_interfaces/msg/Time']
JointState = STORE.types[JOINT_STATE]

floats = st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=9)
names = st.lists(st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=20),
                 max_size=9)
messages = st.tuples(st.integers(0, 2**31 * 10**9 - 1), names, floats, floats, floats,
                     st.text('abcdefgh', max_size=9))


def rosbags_message(stamp, joints, position, velocity, effort, frame):
    header = Header(stamp=Time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id=frame)
    arrays = (np.array(x, dtype=float) for x in (position, velocity, effort))
    return JointState(header, joints, *arrays)


def decode(raw):
    """Return the block of a single message, None if it cannot be decoded."""
    (batch,) = batched(iter([(0, raw)]))
    return next(LayoutDecoder().decode(batch), None)


@given(messages)
@example((0, [], [], [], [], ''))
@example((10**18, ['a'], [], [1.0], [], 'b'))
def test_rosbags_decodes_our_messages(message):
    stamp, joints, position, velocity, effort, frame = message
    decoded = STORE.deserialize_cdr(encode(stamp, joints, position, velocity, effort, frame),
                                    JOINT_STATE)
    assert decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec == stamp
    assert decoded.header.frame_id == frame
    assert decoded.name == joints
    np.testing.assert_array_equal(decoded.position, position)
    np.testing.assert_array_equal(decoded.velocity, velocity)
    np.testing.assert_array_equal(decoded.effort, effort)


@given(messages, st.booleans())
def test_we_decode_messages_of_rosbags(message, little):
    raw = STORE.serialize_cdr(rosbags_message(*message), JOINT_STATE, little_endian=little)
    decoded = decode(bytes(raw))
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
    decoded = decode(bytes(raw[:cut]))
    assert decoded is None or decoded.position.size <= len(raw)


def test_every_cut_of_a_message_and_other_encodings_are_refused():
    raw = encode(5, ['a', 'bc'], [1, 2], [3, 4], [5, 6])
    assert decode(raw).names == ('a', 'bc')
    assert all(decode(raw[:length]) is None for length in range(len(raw)))
    assert all(decode(bytes([0, kind]) + raw[2:]) is None for kind in (2, 3, 6, 7, 255))


def test_definition_and_hash_are_those_of_the_type():
    ours = [line for line in JOINT_STATE_DEFINITION.splitlines() if line]
    printed = STORE.generate_msgdef(JOINT_STATE, ros_version=2)[0]
    assert ours == [line for line in printed.splitlines() if line]
    assert STORE.hash_rihs01(JOINT_STATE) == JOINT_STATE_HASH
