"""Decoding of sensor_msgs/JointState in CDR and in the serialisation of ROS 1; encoding in CDR."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import struct

from gravity_comp_ros.data.samples import FloatArray
import numpy as np
from numpy.typing import ArrayLike

JOINT_STATE = 'sensor_msgs/msg/JointState'
# Type and encoding of a topic of joint states, of ROS 2 and of ROS 1.
CDR, ROS1 = (JOINT_STATE, 'cdr'), ('sensor_msgs/JointState', 'ros1')
JOINT_STATE_HASH = 'RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e'
JOINT_STATE_DEFINITION = f"""\
std_msgs/Header header

string[] name
float64[] position
float64[] velocity
float64[] effort

{'=' * 80}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id

{'=' * 80}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

# Length of the CDR encapsulation header, bytes; alignment is relative to its end.
_HEADER = 4


@dataclass(frozen=True, eq=False)
class JointStateMessage:
    """A decoded message: stamp in ns, K names, and arrays of any length."""

    stamp_ns: int
    names: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray


@dataclass(frozen=True)
class Spans:
    """
    Byte offsets of the parts of a message.

    `names`: begin and end of the name sequence. `arrays`: for position, velocity and effort, the
    offset of the count, the offset of the values, and the number of values.
    """

    names: tuple[int, int]
    arrays: tuple[tuple[int, int, int], ...]


class JointStateDecoder:
    """
    Decoder for the JointState messages of one topic.

    Publishers repeat their joint names in every message. The last name block is cached, so that
    identical bytes are decoded once.

    :param ros1: messages of ROS 1, which has no padding, and a sequence number in place of the
        encapsulation header.
    """

    def __init__(self, ros1: bool = False) -> None:
        self._block: bytes | None = None
        self._order = ''
        self._names: tuple[str, ...] = ()
        self._ros1 = ros1

    def decode(self, data: bytes) -> tuple[JointStateMessage, Spans]:
        """
        Return the message in `data`, and the offsets of its parts.

        :raises ValueError: if the bytes are not a JointState in plain CDR, or of ROS 1.
        """
        if len(data) < _HEADER or not self._ros1 and (data[0] != 0 or data[1] not in (0, 1)):
            raise ValueError('not plain CDR')
        order = '<' if self._ros1 or data[1] == 1 else '>'
        arrays, spans = [], []
        try:
            seconds, nanoseconds, frame = struct.unpack_from(order + 'iII', data, _HEADER)
            start = self._aligned(_HEADER + 12 + frame, 4)
            names, end = self._read_names(data, order, start)
            after_names = end
            for _ in range(3):
                count = self._aligned(end, 4)
                values, end = self._read_doubles(data, order, end)
                arrays.append(values)
                spans.append((count, end - 8 * len(values), len(values)))
        except struct.error:
            raise ValueError('the message ends early') from None
        message = JointStateMessage(seconds * 10**9 + nanoseconds, names, *arrays)
        return message, Spans((start, after_names), tuple(spans))

    def _read_names(self, data: bytes, order: str, start: int) -> tuple[tuple[str, ...], int]:
        if self._block and order == self._order and data.startswith(self._block, start):
            return self._names, start + len(self._block)
        (count,) = struct.unpack_from(order + 'I', data, start)
        names, end = [], start + 4
        if count > len(data):
            raise ValueError('more names than bytes')
        for _ in range(count):
            end = self._aligned(end, 4)
            (length,) = struct.unpack_from(order + 'I', data, end)
            end += 4 + length
            if end > len(data):
                raise ValueError('a name ends after the message')
            names.append(data[end - length:end].rstrip(b'\0').decode('utf-8'))
        self._block, self._order, self._names = bytes(data[start:end]), order, tuple(names)
        return self._names, end

    def _read_doubles(self, data: bytes, order: str, start: int) -> tuple[FloatArray, int]:
        start = self._aligned(start, 4)
        (count,) = struct.unpack_from(order + 'I', data, start)
        start += 4
        if count == 0:  # an empty sequence has no padding after its length
            return np.empty(0), start
        start = self._aligned(start, 8)
        if start + 8 * count > len(data):
            raise ValueError('an array ends after the message')
        return np.frombuffer(data, order + 'f8', count, start), start + 8 * count

    def _aligned(self, offset: int, size: int) -> int:
        return offset if self._ros1 else offset + -(offset - _HEADER) % size


def encode(stamp_ns: int, names: Sequence[str], position: ArrayLike = (),
           velocity: ArrayLike = (), effort: ArrayLike = (), frame_id: str = '') -> bytes:
    """
    Return a JointState as little-endian CDR.

    :param stamp_ns: time in ns since the epoch, from 0 to 2**31 seconds.
    """
    seconds, nanoseconds = divmod(int(stamp_ns), 10**9)
    out = bytearray(struct.pack('<BBHiI', 0, 1, 0, seconds, nanoseconds))
    _put_string(out, frame_id)
    _put_length(out, len(names))
    for name in names:
        _put_string(out, name)
    for values in (position, velocity, effort):
        array = np.asarray(values, dtype='<f8').ravel()
        _put_length(out, array.size)
        if array.size:
            out += bytes(-(len(out) - _HEADER) % 8)
            out += array.tobytes()
    return bytes(out)


def _put_length(out: bytearray, length: int) -> None:
    out += bytes(-len(out) % 4)
    out += struct.pack('<I', length)


def _put_string(out: bytearray, text: str) -> None:
    raw = text.encode('utf-8') + b'\0'
    _put_length(out, len(raw))
    out += raw
