"""Messages of a topic gathered into columns, one a joint, whatever order each message had."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.recordings.message_batch import Batch
from gravity_comp_ros.recordings.message_layout import Block
import numpy as np

UNDECODABLE = 'not decodable'
DUPLICATE = 'duplicate joint name'
SIZES = 'arrays of different lengths'

_MAX_NS = 2**63 - 1


class _Layout:
    """All messages with one sequence of names, as flat rows of numbers."""

    def __init__(self) -> None:
        self.rows = array('q')
        self.position, self.velocity, self.effort = array('d'), array('d'), array('d')

    def take(self, rows: IntArray, block: Block) -> None:
        self.rows.frombytes(rows.astype(np.int64, copy=False).tobytes())
        for store, values in ((self.position, block.position), (self.velocity, block.velocity),
                              (self.effort, block.effort)):
            if not values.shape[1]:
                values = np.full((len(rows), len(block.names)), np.nan)
            store.frombytes(values.tobytes())


class Columns:
    """
    Well-formed messages in their order, and the count of those that were not.

    Rows of messages with the same names lie together, so that a long recording costs 24 bytes
    a joint and message.

    :param rename: other names for joints, by the name in the messages.
    """

    def __init__(self, rename: Mapping[str, str] | None = None) -> None:
        self.dropped: Counter[str] = Counter()
        self.recorded: set[str] = set()   # names as they are in the messages
        self._rename = dict(rename or {})
        self._log_ns, self._stamp_ns = array('q'), array('q')
        self._layouts: dict[tuple[str, ...], _Layout] = {}

    def __len__(self) -> int:
        return len(self._log_ns)

    def add(self, batch: Batch, blocks: Iterable[Block]) -> None:
        """Take the messages of a batch, or count why not; those in no block are undecodable."""
        good = np.zeros(len(batch), dtype=bool)
        stamps = np.zeros(len(batch), dtype=np.int64)
        taken, seen = [], 0
        for block in blocks:
            seen += len(block.which)
            reason = self._defect(block)
            if reason:
                self.dropped[reason] += len(block.which)
                continue
            good[block.which] = True
            stamps[block.which] = block.stamp_ns
            taken.append(block)
        if seen < len(batch):
            self.dropped[UNDECODABLE] += len(batch) - seen
        rows = len(self) + np.cumsum(good) - 1
        for block in taken:
            self.recorded.update(block.names)
            names = self._named(block.names)
            self._layouts.setdefault(names, _Layout()).take(rows[block.which], block)
        self._log_ns.frombytes(np.minimum(batch.log_ns[good], _MAX_NS).astype('i8').tobytes())
        self._stamp_ns.frombytes(stamps[good].tobytes())

    def _defect(self, block: Block) -> str | None:
        size, names = len(block.names), self._named(block.names)
        if names not in self._layouts and len(set(names)) < size:
            return DUPLICATE
        if (not size or block.position.shape[1] != size
                or block.velocity.shape[1] not in (0, size)
                or block.effort.shape[1] not in (0, size)):
            return SIZES
        return None

    def _named(self, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(self._rename.get(name, name) for name in names) if self._rename else names

    @property
    def names(self) -> tuple[str, ...]:
        """All joint names, in order of their first appearance."""
        return tuple(dict.fromkeys(name for layout in self._layouts for name in layout))

    @property
    def layouts(self) -> tuple[tuple[str, ...], ...]:
        """The sequences of names that messages have, in order of their first appearance."""
        return tuple(self._layouts)

    @property
    def most_common(self) -> tuple[str, ...]:
        """The joint names that most messages have."""
        return max(self._layouts, key=lambda names: len(self._layouts[names].rows))

    @property
    def log_ns(self) -> IntArray:
        return np.frombuffer(self._log_ns, dtype=np.int64)

    @property
    def stamp_ns(self) -> IntArray:
        return np.frombuffer(self._stamp_ns, dtype=np.int64)

    def presence(self, joints: Sequence[str]) -> BoolArray:
        """Return which message (M,) has which joint (N,)."""
        found = np.zeros((len(self), len(joints)), dtype=bool)
        for names, layout in self._layouts.items():
            found[np.array(layout.rows)] = [joint in names for joint in joints]
        return found

    def values(self, joints: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """
        Return position, velocity and effort, each (M, N); NaN where a message has none.

        Where all messages are alike the arrays are the columns themselves, which then take no
        more messages.
        """
        shape = (len(self), len(joints))
        if self.layouts == (tuple(joints),):
            layout = self._layouts[tuple(joints)]
            if (np.diff(np.frombuffer(layout.rows, dtype=np.int64)) > 0).all():
                q, qd, tau = (np.frombuffer(flat).reshape(shape) for flat in (
                    layout.position, layout.velocity, layout.effort))
                return q, qd, tau
        out = (np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan))
        for names, layout in self._layouts.items():
            target = [k for k, joint in enumerate(joints) if joint in names]
            source = [names.index(joints[k]) for k in target]
            rows = np.array(layout.rows)
            for array_out, flat in zip(out, (layout.position, layout.velocity, layout.effort)):
                table = np.frombuffer(flat).reshape(len(rows), len(names))
                array_out[rows[:, None], target] = table[:, source]
        return out
