"""
Robot description in a recording.

robot_state_publisher publishes the URDF once as a transient-local std_msgs/String, which a
recorder of all topics stores.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
import struct

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.messages import Storage
from gravity_comp_ros.recordings.storage import open_storage

STRING = 'std_msgs/msg/String'
TOPIC = '/robot_description'

_MAX_BYTES = 32 * 2 ** 20


@dataclass(frozen=True)
class RecordedDescription:
    """Text of a URDF, with its topic and recording."""

    text: str
    topic: str
    path: Path

    @property
    def source(self) -> str:
        """Name of the description in messages."""
        return f'{self.topic} in {self.path.name or self.path.resolve().name}'


def robot_description(path: Path | str) -> RecordedDescription | None:
    """
    Return the latest message on /robot_description, None if there is none.

    Without that topic, the only topic of this name in a namespace is used.

    :raises BagError: if the recording cannot be read, or the message is damaged.
    """
    path = Path(path)
    with open_storage(path) as storage:
        topic = _topic(storage)
        if topic is None:
            return None
        latest = b''
        for batch in storage.batches(topic):
            latest = batch.message(-1)
    if not latest:
        return None
    try:
        return RecordedDescription(decode_string(latest), topic, path)
    except ValueError as problem:
        raise BagError(f'{path}, topic {topic}: the robot description cannot be decoded: '
                       f'{problem}') from None


def first_description(paths: Iterable[Path | str]) -> RecordedDescription | None:
    """
    Return the description of the first recording that contains one.

    :raises BagError: as `robot_description`.
    """
    return next((found for path in paths if (found := robot_description(path))), None)


def decode_string(data: bytes) -> str:
    """
    Return the text of a std_msgs/String in plain CDR.

    :raises ValueError: if the bytes are not such a message.
    """
    if len(data) < 8 or data[0] != 0 or data[1] not in (0, 1):
        raise ValueError('not plain CDR')
    (length,) = struct.unpack_from('<I' if data[1] else '>I', data, 4)
    if length > _MAX_BYTES or 8 + length > len(data):
        raise ValueError('the text ends after the message')
    return data[8:8 + length].rstrip(b'\0').decode('utf-8')


def encode_string(text: str) -> bytes:
    """Return a std_msgs/String in plain CDR."""
    data = text.encode() + b'\0'
    return b'\0\1\0\0' + struct.pack('<I', len(data)) + data


def _topic(storage: Storage) -> str | None:
    topics = {topic.name for topic, count in storage.topics.items()
              if topic[1:] == (STRING, 'cdr') and count and topic.name.endswith(TOPIC)}
    if TOPIC in topics:
        return TOPIC
    return topics.pop() if len(topics) == 1 else None
