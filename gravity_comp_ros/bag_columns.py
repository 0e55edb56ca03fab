"""Messages of a topic gathered into columns, one a joint, whatever order each message had."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.bag_message import JointStateMessage
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

DUPLICATE = 'duplicate joint name'
SIZES = 'arrays of different lengths'

_MAX_NS = 2**63 - 1


@dataclass
class _Layout:
    """All messages with one sequence of names, as flat rows of numbers."""

    rows: array
    position: array
    velocity: array
    effort: array


class Columns:
    """
    Well-formed messages in their order, and the count of those that were not.

    Rows of messages with the same names lie together, so that a long recording costs 24 bytes
    a joint and message.
    """

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self._log_ns, self._stamp_ns = array('q'), array('q')
        self._layouts: dict[tuple[str, ...], _Layout] = {}

    def __len__(self) -> int:
        return len(self._log_ns)

    def add(self, log_ns: int, message: JointStateMessage) -> None:
        """Take a message, or count why not."""
        names = message.names
        size = len(names)
        layout = self._layouts.get(names)
        if layout is None:
            if len(set(names)) < size:
                self.dropped[DUPLICATE] += 1
                return
            if size:
                layout = _Layout(array('q'), array('d'), array('d'), array('d'))
        if (layout is None or len(message.position) != size
                or len(message.velocity) not in (0, size)
                or len(message.effort) not in (0, size)):
            self.dropped[SIZES] += 1
            return
        self._layouts[names] = layout
        layout.rows.append(len(self))
        self._log_ns.append(min(log_ns, _MAX_NS))
        self._stamp_ns.append(message.stamp_ns)
        for store, values in ((layout.position, message.position),
                              (layout.velocity, message.velocity),
                              (layout.effort, message.effort)):
            if not len(values):
                values = np.full(size, np.nan)
            store.frombytes(np.ascontiguousarray(values, dtype=np.float64).tobytes())

    @property
    def names(self) -> tuple[str, ...]:
        """All joint names, in order of their first appearance."""
        return tuple(dict.fromkeys(name for layout in self._layouts for name in layout))

    @property
    def most_common(self) -> tuple[str, ...]:
        """The joint names that most messages have."""
        return max(self._layouts, key=lambda names: len(self._layouts[names].rows))

    @property
    def log_ns(self) -> NDArray[np.int64]:
        return np.array(self._log_ns, dtype=np.int64)

    @property
    def stamp_ns(self) -> NDArray[np.int64]:
        return np.array(self._stamp_ns, dtype=np.int64)

    def presence(self, joints: Sequence[str]) -> NDArray[np.bool_]:
        """Return which message (M,) has which joint (N,)."""
        found = np.zeros((len(self), len(joints)), dtype=bool)
        for names, layout in self._layouts.items():
            found[np.array(layout.rows)] = [joint in names for joint in joints]
        return found

    def values(self, joints: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position, velocity and effort, each (M, N); NaN where a message has none."""
        shape = (len(self), len(joints))
        out = (np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan))
        for names, layout in self._layouts.items():
            target = [k for k, joint in enumerate(joints) if joint in names]
            source = [names.index(joints[k]) for k in target]
            rows = np.array(layout.rows)
            for array_out, flat in zip(out, (layout.position, layout.velocity, layout.effort)):
                table = np.frombuffer(flat).reshape(len(rows), len(names))
                array_out[rows[:, None], target] = table[:, source]
        return out
