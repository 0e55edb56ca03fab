"""
Joint states and the robot description of MCAP files, rosbag2 folders and .db3 files.

robot_state_publisher publishes the URDF once as a transient-local std_msgs/String, which a
recorder of all topics stores.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
import struct
from typing import Any

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import BagError, ModelMismatchError
from gravity_comp_ros.recordings.cleaning import Cleaning, listed
from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.messages import Storage
from gravity_comp_ros.recordings.read_options import ReadOptions, ReadReport, Recording
from gravity_comp_ros.recordings.storage import open_storage
from gravity_comp_ros.recordings.topic_choice import choose_joints, choose_topic, named_joints
import numpy as np

__all__ = ['decode_string', 'encode_string', 'joint_goals',
           'joint_positions', 'read_bag', 'ReadOptions', 'ReadReport', 'RecordedDescription',
           'Recording', 'robot_description', 'STRING']

STRING = 'std_msgs/msg/String'
TOPIC = '/robot_description'
_MAX_BYTES = 32 * 2 ** 20


def read_bag(path: str | Path, options: ReadOptions = ReadOptions()) -> Recording:
    """
    Return the samples of one bag.

    Joints are matched by name in each message. Invalid messages are dropped and counted: missing
    joints, more or fewer values than joints, duplicate names, NaN, time that does not increase.
    Time is the header stamp if it increases, else the log time. The signals are judged
    (`facts.judge`): safe corrections are made and listed in the report.

    :raises BagError: if the recording is missing, damaged or empty, has no JointState topic, at
        least half of its messages have the same defect, or its signals are refused.
    :raises ModelMismatchError: if a joint named in the options is missing.
    """
    path = Path(path)
    with open_storage(path) as storage:
        topic, notes = choose_topic(path, storage, options.topic)
        count = max(n for one, n in storage.topics.items() if one.name == topic)
        limit = options.max_messages
        share = 1.0 if limit is None else min(limit / max(count, 1), 1.0)
        columns = Columns(storage, topic, options.rename, share)
        notes += storage.notes
        if share < 1.0:
            notes.append(f'{share:.0%} of {count} messages are used, to limit memory')
    n_messages = len(columns) + sum(columns.dropped.values())
    where = f'{path}, topic {topic}'
    if not n_messages:
        raise BagError(f'{where} has no messages')
    if not len(columns):
        raise BagError(f'{where} has no usable message: {listed(columns.dropped)}')
    unknown = [name for name in options.rename if name not in columns.recorded]
    if unknown:
        raise ModelMismatchError(f'{where} has no joint {", ".join(unknown)} (to be renamed); it '
                                 f'has {", ".join(sorted(columns.recorded))}')
    options = _with_joint_names(where, columns.names, options)
    joints, facts = choose_joints(where, columns, options)
    cleaning = Cleaning(where, columns, joints, notes, facts, options)
    del columns
    return cleaning.recording(path, topic, n_messages)


def joint_positions(path: Path | str, joints: Collection[str],
                    options: ReadOptions = ReadOptions()) -> dict[str, FloatArray]:
    """
    Return the finite recorded positions, in rad or m, of those `joints` that have any.

    :param options: topic; unit, names, zeros and signs of the positions.
    :raises BagError: if the recording cannot be read, or has no such topic.
    """
    _, columns = _columns(Path(path), options.topic, options.rename)
    names = [name for name in columns.names if name in joints]
    finite = {name: values[np.isfinite(values)]
              for name, values in zip(names, _positions(columns, names, options).T)}
    return {name: values for name, values in finite.items() if values.size}


def joint_goals(path: Path | str, topic: str, joints: tuple[str, ...],
                options: ReadOptions = ReadOptions()) -> tuple[FloatArray, FloatArray]:
    """
    Return times (G,) in s since the epoch and goals (G, N) in rad of a topic, in order of time.

    Times are the stamps, or the log times if a message has none. Messages without a finite goal
    of every joint are left out.

    :param topic: JointState topic whose positions are goals.
    :param options: unit, names, zeros and signs of the positions.
    :raises BagError: if the recording cannot be read, or has no such topic or goals.
    :raises ModelMismatchError: if a joint has no goal.
    """
    where, columns = _columns(Path(path), topic, options.rename)
    options = _with_joint_names(where, columns.names,
                                replace(options, joints=joints, effort_scale={},
                                        effort_unit='Nm', rated_torque={}))
    goal = _positions(columns, joints, options)
    times = columns.stamp_ns if len(columns) and columns.stamp_ns.min() > 0 else columns.log_ns
    known = np.isfinite(goal).all(axis=1)
    if not known.any():
        raise BagError(f'{where} has no finite goal of {", ".join(joints)}')
    order = np.argsort(times[known], kind='stable')
    return np.asarray(times[known][order] * 1e-9, dtype=np.float64), goal[known][order]


def _columns(path: Path, topic: str | None, rename: Mapping[str, str] | None = None
             ) -> tuple[str, Columns]:
    """Return the recording and its topic as text, and the columns of the topic."""
    with open_storage(path) as storage:
        topic = choose_topic(path, storage, topic)[0]
        return f'{path}, topic {topic}', Columns(storage, topic, rename)


def _positions(columns: Columns, joints: Sequence[str], options: ReadOptions) -> FloatArray:
    sign, unit, zero = options.to_model(joints)
    return np.asarray(sign * (unit * columns.values(joints)[0] - zero))


def _with_joint_names(where: str, names: tuple[str, ...], options: ReadOptions) -> ReadOptions:
    """Return the options with joint numbers replaced by names."""
    def named(requested: Iterable[str], what: str) -> tuple[str, ...]:
        return named_joints(where, names, requested, what)

    def by_name(values: Mapping[str, Any], what: str) -> dict[str, Any]:
        return dict(zip(named(values, what), values.values()))

    unit, joints = options.position_unit, options.joints
    return replace(options, effort_scale=by_name(options.effort_scale, 'scaled'),
                   joints=None if joints is None else named(joints, 'to be read'),
                   zero=by_name(options.zero, 'zero'),
                   position_unit=unit if isinstance(unit, str) else by_name(unit, 'unit'),
                   rated_torque=by_name(options.rated_torque, 'rated torque'),
                   reverse=named(options.reverse, 'reversed'))


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
