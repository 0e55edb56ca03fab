"""Positions of joints that are in a recording, but not among those that are learned."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from gravity_comp_ros.recordings.joint_columns import Columns
from gravity_comp_ros.recordings.message_layout import LayoutDecoder
from gravity_comp_ros.recordings.storage import open_storage
from gravity_comp_ros.recordings.topic_choice import choose_topic
import numpy as np


@dataclass(frozen=True)
class PositionRange:
    """The median position of a joint and the range it keeps to, in rad or m."""

    median: float
    low: float
    high: float

    @property
    def span(self) -> float:
        return self.high - self.low


def joint_positions(path: Path | str, joints: Collection[str],
                    topic: str | None = None) -> dict[str, PositionRange]:
    """
    Return where those of the joints are that the recording has; effort is not needed.

    :param topic: of the joint states; None for the usual one.
    :raises BagError: if the recording cannot be read, or has no such topic.
    """
    path = Path(path)
    columns, decoder = Columns(), LayoutDecoder()
    with open_storage(path) as storage:
        chosen, _ = choose_topic(path, storage, topic)
        for batch in storage.batches(chosen):
            columns.add(batch, decoder.decode(batch))
    names = [name for name in columns.names if name in joints]
    positions = columns.values(names)[0]
    found = {}
    for name, values in zip(names, positions.T):
        known = values[np.isfinite(values)]
        if known.size:
            found[name] = PositionRange(float(np.median(known)), float(known.min()),
                                        float(known.max()))
    return found
