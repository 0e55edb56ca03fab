"""CDR encoding of JointState, against the serialiser of rosbags and with damaged bytes."""

from gravity_comp_ros.recordings.joint_state_cdr import (
    encode, JOINT_STATE, JOINT_STATE_DEFINITION, JOINT_STATE_HASH, JointStateDecoder)
from hypothesis import example, given, strategies as st
import numpy as np
import pytest
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


def check_equal(message, stamp, joints, position, velocity, effort, frame):
    assert message.stamp_ns == stamp
    assert message.names == tuple(joints)
    np.testing.assert_array_equal(message.position, position)
    np.testing.assert_array_equal(message.velocity, velocity)
    np.testing.assert_array_equal(message.effort, effort)


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


@given(st.lists(messages, min_size=1, max_size=4), st.booleans())
def test_we_decode_messages_of_rosbags(sequence, little):
    decoder = JointStateDecoder()  # one for all messages, to test its cache of names
    for message in sequence:
        raw = STORE.serialize_cdr(rosbags_message(*message), JOINT_STATE, little_endian=little)
        check_equal(decoder.decode(bytes(raw))[0], *message)


@given(messages, st.data())
def test_damaged_bytes_are_refused_or_read_but_never_crash(message, data):
    raw = bytearray(encode(*message))
    cut = data.draw(st.integers(0, len(raw)))
    place = data.draw(st.integers(0, len(raw) - 1))
    raw[place] = data.draw(st.integers(0, 255))
    try:
        decoded = JointStateDecoder().decode(bytes(raw[:cut]))[0]
    except ValueError:
        return
    assert len(decoded.position) <= len(raw)


def test_every_cut_of_a_message_is_refused():
    raw = encode(5, ['a', 'bc'], [1, 2], [3, 4], [5, 6])
    decoder = JointStateDecoder()
    decoder.decode(raw)
    for length in range(len(raw)):
        with pytest.raises(ValueError):
            decoder.decode(raw[:length])


@pytest.mark.parametrize('kind', [2, 3, 6, 7, 255])
def test_other_encodings_are_refused(kind):
    raw = bytearray(encode(5, ['a'], [1.0]))
    raw[1] = kind
    with pytest.raises(ValueError, match='not plain CDR'):
        JointStateDecoder().decode(bytes(raw))


def test_definition_and_hash_are_those_of_the_type():
    ours = [line for line in JOINT_STATE_DEFINITION.splitlines() if line]
    printed = STORE.generate_msgdef(JOINT_STATE, ros_version=2)[0]
    assert ours == [line for line in printed.splitlines() if line]
    assert STORE.hash_rihs01(JOINT_STATE) == JOINT_STATE_HASH
