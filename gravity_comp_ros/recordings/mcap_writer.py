"""Writer of JointState topics to MCAP files, as read by rosbag2, PlotJuggler and Foxglove."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import heapq
from itertools import count, repeat
import json
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from gravity_comp_ros.atomic import replacing
from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import BagError, OptionError
from gravity_comp_ros.recordings.bag import (
    encode_string, RecordedDescription, STRING)
from gravity_comp_ros.recordings.joint_state_cdr import (
    encode, JOINT_STATE, JOINT_STATE_DEFINITION, JOINT_STATE_HASH)
from mcap.writer import CompressionType, Writer
import numpy as np

# Default date of time 0 of the samples, ns since the epoch; in ROS a stamp of 0 means "not set".
DEFAULT_START_NS = 1_700_000_000 * 10**9
# Bytes of records per chunk, which is read at once.
_CHUNK_BYTES = 256 * 1024


@dataclass(frozen=True, eq=False)
class JointTopic:
    """
    One topic of M messages with N joints.

    `t` (M,) in s; `position`, `velocity` and `effort` (M, N), None for an empty field. Values may
    be NaN.

    :raises OptionError: if a shape disagrees.
    """

    name: str
    joints: tuple[str, ...]
    t: FloatArray
    position: FloatArray | None = None
    velocity: FloatArray | None = None
    effort: FloatArray | None = None

    def __post_init__(self) -> None:
        if not self.name.startswith('/'):
            raise OptionError(f'topic {self.name!r} must begin with a slash')
        shape = (len(self.t), len(self.joints))
        for what in ('position', 'velocity', 'effort'):
            values = getattr(self, what)
            if values is not None and np.shape(values) != shape:
                raise OptionError(f'topic {self.name}: {what} has shape {np.shape(values)}; '
                                  f'expected {shape}')


def joint_states(samples: JointSamples, topic: str = '/joint_states') -> JointTopic:
    """
    Return the samples of a single run as a topic.

    :raises OptionError: if there are several runs, which require one bag each.
    """
    if samples.n_runs != 1:
        raise OptionError(f'{samples.n_runs} runs cannot be one topic; write one bag per run')
    return JointTopic(topic, samples.names, samples.t, samples.q, samples.qd, samples.tau)


def write_bag(path: str | Path, topics: Sequence[JointTopic], start_ns: int = DEFAULT_START_NS,
              metadata: Mapping[str, Mapping[str, object]] = MappingProxyType({}),
              description: RecordedDescription | None = None) -> int:
    """
    Write the topics to an MCAP file, in order of time, and return the number of messages.

    The log time of a message is its header stamp. An existing file is replaced atomically.

    :param start_ns: time of t = 0, ns since the epoch.
    :param metadata: metadata records by name; their values are strings or JSON values.
    :param description: robot description to write on its topic before all others.
    :raises BagError: if the file cannot be written; an existing file is then unchanged.
    :raises OptionError: if topic names repeat, or a time does not fit a stamp.
    """
    names = [topic.name for topic in topics]
    if len(set(names)) != len(names):
        raise OptionError(f'topics repeat: {", ".join(names)}')
    stamps = [_stamps(topic, start_ns) for topic in topics]
    with replacing(Path(path), BagError) as temporary:
        with temporary.open('wb') as stream:
            _write(stream, topics, stamps, metadata, start_ns, description)
    return sum(len(topic.t) for topic in topics)


def _write(stream: BinaryIO, topics: Sequence[JointTopic], stamps: Sequence[IntArray],
           metadata: Mapping[str, Mapping[str, object]], start_ns: int,
           description: RecordedDescription | None) -> None:
    writer = Writer(stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
    writer.start(profile='ros2', library='gravity_comp_ros')
    schema = writer.register_schema(JOINT_STATE, 'ros2msg', JOINT_STATE_DEFINITION.encode())
    channels = [writer.register_channel(topic.name, 'cdr', schema,
                                        {'topic_type_hash': JOINT_STATE_HASH})
                for topic in topics]
    for name, record in metadata.items():
        writer.add_metadata(name, {key: value if isinstance(value, str) else json.dumps(
            value, ensure_ascii=False) for key, value in record.items()})
    if description is not None:
        schema = writer.register_schema(STRING, 'ros2msg', b'string data\n')
        channel = writer.register_channel(description.topic, 'cdr', schema)
        writer.add_message(channel, start_ns, encode_string(description.text), start_ns)
    counts = [0] * len(topics)
    events = (zip(stamp.tolist(), repeat(k), count()) for k, stamp in enumerate(stamps))
    for stamp, number, row in heapq.merge(*events):
        topic = topics[number]
        position, velocity, effort = (
            () if values is None else values[row]
            for values in (topic.position, topic.velocity, topic.effort))
        data = encode(stamp, topic.joints, position, velocity, effort)
        writer.add_message(channels[number], stamp, data, stamp, counts[number])
        counts[number] += 1
    writer.finish()


def _stamps(topic: JointTopic, start_ns: int) -> IntArray:
    t = np.asarray(topic.t, dtype=np.float64)
    if not np.isfinite(t).all() or (np.diff(t) < 0).any():
        raise OptionError(f'topic {topic.name}: times must be finite and not go back')
    if t.size and not (0 <= start_ns + t[0] * 1e9 and start_ns + t[-1] * 1e9 < 2**31 * 1e9):
        raise OptionError(f'topic {topic.name}: times from {t[0]} to {t[-1]} s do not fit a stamp')
    return start_ns + np.round(t * 1e9).astype(np.int64)
