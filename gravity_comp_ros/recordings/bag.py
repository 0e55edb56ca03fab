"""Read joint states from MCAP files, rosbag2 folders and bare .db3 files."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from gravity_comp_ros.errors import BagError, ModelMismatchError
from gravity_comp_ros.recordings.cleaning import Cleaning, listed
from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.message_layout import LayoutDecoder
from gravity_comp_ros.recordings.read_options import ReadOptions, ReadReport, Recording
from gravity_comp_ros.recordings.storage import open_storage
from gravity_comp_ros.recordings.storage_interface import Storage
from gravity_comp_ros.recordings.topic_choice import choose_joints, choose_topic, named_joints
import numpy as np

# Multiples of the golden ratio fill the unit interval evenly, any part of them.
_GOLDEN = (5.0 ** 0.5 - 1.0) / 2.0
__all__ = ['joint_positions', 'read_bag', 'ReadOptions', 'ReadReport', 'Recording']


@dataclass(frozen=True)
class PositionRange:
    """The median position of a joint and the range it keeps to, in rad or m."""

    median: float
    low: float
    high: float

    @property
    def span(self) -> float:
        return self.high - self.low


def read_bag(path: str | Path, options: ReadOptions = ReadOptions()) -> Recording:
    """
    Return the samples of one bag.

    Joints are matched by name, message by message. A message that cannot be used (joints
    missing, arrays of different lengths, duplicate names, NaN, time that does not increase)
    is dropped and counted. Time is the header's stamp if that increases, else the log time.
    Missing velocities come from the positions, by a filter without delay.

    :raises BagError: if there is no such recording, it is damaged, empty or without a
        JointState topic to read, or at least half of its messages share one defect.
    :raises ModelMismatchError: if a chosen or scaled joint is not in it.
    """
    path = Path(path)
    with open_storage(path) as storage:
        topic, notes = choose_topic(path, storage, options.topic)
        count = max((one.count for one in storage.topics if one.name == topic), default=0)
        share = 1.0 if options.most is None else min(options.most / max(count, 1), 1.0)
        columns = _gather(storage, topic, options.rename, share)
        if share < 1.0:
            notes.append(f'{share:.0%} of {count} messages are used, so that memory is bounded')
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
    options = _by_name(where, columns.names, options)
    joints = choose_joints(where, columns, options.joints)
    cleaning = Cleaning(where, columns, joints, notes, options.degrees)
    del columns
    return cleaning.recording(path, topic, n_messages, options)


def joint_positions(path: Path | str, joints: Collection[str],
                    topic: str | None = None) -> dict[str, PositionRange]:
    """
    Return where those of the joints are that the recording has; effort is not needed.

    :param topic: of the joint states; None for the usual one.
    :raises BagError: if the recording cannot be read, or has no such topic.
    """
    path = Path(path)
    with open_storage(path) as storage:
        columns = _gather(storage, choose_topic(path, storage, topic)[0])
    names = [name for name in columns.names if name in joints]
    positions = columns.values(names)[0]
    found = {}
    for name, values in zip(names, positions.T):
        known = values[np.isfinite(values)]
        if known.size:
            found[name] = PositionRange(float(np.median(known)), float(known.min()),
                                        float(known.max()))
    return found


def _by_name(where: str, known: tuple[str, ...], options: ReadOptions) -> ReadOptions:
    """Return the options with joints by name where they were given by number."""
    scaled = named_joints(where, known, options.effort_scale, 'scaled')
    scale = dict(zip(scaled, options.effort_scale.values()))
    chosen = options.joints
    if chosen is not None:
        chosen = named_joints(where, known, chosen, 'chosen')
    return replace(options, joints=chosen, effort_scale=scale)


def _gather(storage: Storage, topic: str, rename: Mapping[str, str] | None = None,
            share: float = 1.0) -> Columns:
    """Decode a share of the messages of a topic."""
    columns, decoder, seen = Columns(rename), LayoutDecoder(), 0
    for batch in storage.batches(topic):
        seen += len(batch)
        if share < 1.0:
            # Not every k-th: publishers may take turns.
            batch = batch.select(np.arange(seen - len(batch), seen) * _GOLDEN % 1.0 < share)
        columns.add(batch, decoder.decode(batch))
    return columns
