"""
sensor_msgs/JointState in CDR: names and definition of the type, encoding, vectorised decoding.

A publisher usually sends the same joints in the same order, so that the numbers have the same
offsets in all its messages. The first message of a layout gives these offsets. Messages with its
length and its names are decoded together, by columns of bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import struct

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.recordings.messages import Batch, Bytes, Places
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
HEADER = 4


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
            out += bytes(-(len(out) - HEADER) % 8)
            out += array.tobytes()
    return bytes(out)


def _put_length(out: bytearray, length: int) -> None:
    out += bytes(-len(out) % 4)
    out += struct.pack('<I', length)


def _put_string(out: bytearray, text: str) -> None:
    raw = text.encode('utf-8') + b'\0'
    _put_length(out, len(raw))
    out += raw


@dataclass(frozen=True, eq=False)
class Block:
    """
    Messages of a batch with the same names: stamps (M,) in ns and values (M, any).

    `which` (M,) are their indices in the batch. Empty arrays of the messages are (M, 0).
    """

    which: Places
    names: tuple[str, ...]
    stamp_ns: Places
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray


class _Layout:
    """
    Layout of a message: its names, bytes that must be equal, and offsets of its numbers.

    :param ros1: a message of ROS 1, which has no padding, and a sequence number in place of the
        encapsulation header of CDR.
    :raises ValueError: if the bytes are not a JointState in plain CDR, or of ROS 1.
    """

    def __init__(self, data: bytes, ros1: bool) -> None:
        if len(data) < HEADER or not ros1 and (data[0] != 0 or data[1] not in (0, 1)):
            raise ValueError('not plain CDR')
        self.length, self._data, self._ros1 = len(data), data, ros1
        self._order = order = '<' if ros1 or data[1] == 1 else '>'
        _, frame = self._text(HEADER + 8)
        count, end = self._count(frame)
        if count > len(data):
            raise ValueError('more names than bytes')
        names = []
        for _ in range(count):
            name, end = self._text(end)
            names.append(name.rstrip(b'\0').decode('utf-8'))
        self.names = tuple(names)
        # Parts that agree in all messages of a layout: the header, the names of frame and joints,
        # and the number of values of each array.
        fixed = [*range(0 if ros1 else HEADER), *range(HEADER + 8, end)]
        fields: dict[str, tuple] = {'sec': (order + 'i4', HEADER),
                                    'nanosec': (order + 'u4', HEADER + 4)}
        for what in ('position', 'velocity', 'effort'):
            count, begin = self._count(end)
            fixed += range(begin - 4, begin)
            begin = self._aligned(begin, 8) if count else begin  # no padding before no values
            end = self._checked(begin + 8 * count)
            fields[what] = ((order + 'f8', (count,)), begin)
        kinds, offsets = zip(*fields.values())
        self._record = np.dtype({'names': [*fields], 'formats': kinds, 'offsets': offsets,
                                 'itemsize': self.length})
        self._places = np.array(fixed)
        self._expected = np.frombuffer(data, dtype=np.uint8)[self._places]

    def _text(self, at: int) -> tuple[bytes, int]:
        """Return a string and its end."""
        length, begin = self._count(at)
        return self._data[begin:begin + length], self._checked(begin + length)

    def _count(self, at: int) -> tuple[int, int]:
        """Return a count and its end."""
        at = self._aligned(at, 4)
        end = self._checked(at + 4)
        return struct.unpack_from(self._order + 'I', self._data, at)[0], end

    def _checked(self, end: int) -> int:
        if end > self.length:
            raise ValueError('the message ends early')
        return end

    def _aligned(self, offset: int, size: int) -> int:
        return offset if self._ros1 else offset + -(offset - HEADER) % size

    def matching(self, rows: Bytes) -> BoolArray:
        """Return the mask (M,) of the rows (M, length) with this layout."""
        return np.asarray((rows[:, self._places] == self._expected).all(axis=1))

    def block(self, which: Places, rows: Bytes) -> Block:
        records = rows.view(self._record)[:, 0]
        stamps = records['sec'].astype(np.int64) * 10**9 + records['nanosec']
        return Block(which, self.names, stamps, *(
            records[what].astype(np.float64) for what in ('position', 'velocity', 'effort')))


def decode(batch: Batch, ros1: bool = False) -> Iterator[Block]:
    """
    Yield the messages of a batch, those of a layout together; undecodable ones are in no block.

    :param ros1: whether the messages are of ROS 1.
    """
    remaining = np.arange(len(batch))
    while remaining.size:
        try:
            layout = _Layout(batch.message(int(remaining[0])), ros1)
        except ValueError:
            remaining = remaining[1:]
            continue
        which = remaining[batch.length[remaining] == layout.length]
        rows = batch.rows(which, layout.length)
        matching = layout.matching(rows)
        if not matching.all():
            which, rows = which[matching], rows[matching]
        yield layout.block(which, rows)
        if len(which) == len(remaining):
            return
        remaining = np.setdiff1d(remaining, which, assume_unique=True)
