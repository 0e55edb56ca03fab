"""sensor_msgs/JointState: names and definition of the type, and encoding in CDR."""

from __future__ import annotations

from collections.abc import Sequence
import struct

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
