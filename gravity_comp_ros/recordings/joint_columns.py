"""Columns of position, velocity and effort by joint, gathered from the messages of a topic."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.recordings.joint_state_cdr import Block
from gravity_comp_ros.recordings.messages import Batch
import numpy as np

UNDECODABLE = 'not decodable'
DUPLICATE = 'duplicate joint name'
SIZES = 'arrays of different lengths'

_MAX_NS = 2**63 - 1


class _Layout:
    """All messages with the same sequence of names, as flat rows of numbers."""

    def __init__(self) -> None:
        self.rows = array('q')
        self.position, self.velocity, self.effort = array('d'), array('d'), array('d')

    def add(self, rows: IntArray, block: Block) -> None:
        self.rows.frombytes(rows.astype(np.int64, copy=False).tobytes())
        for store, values in ((self.position, block.position), (self.velocity, block.velocity),
                              (self.effort, block.effort)):
            if not values.shape[1]:
                values = np.full((len(rows), len(block.names)), np.nan)
            store.frombytes(values.tobytes())


class Columns:
    """
    Valid messages in recorded order, and the number of invalid ones by reason.

    Messages with the same names are stored together: 24 bytes per joint and message.

    :param rename: new names of joints, by the name in the messages.
    """

    def __init__(self, rename: Mapping[str, str] | None = None) -> None:
        self.dropped: Counter[str] = Counter()
        self.recorded: set[str] = set()   # names before `rename`
        self._rename = dict(rename or {})
        self._log_ns, self._stamp_ns = array('q'), array('q')
        self._layouts: dict[tuple[str, ...], _Layout] = {}

    def __len__(self) -> int:
        return len(self._log_ns)

    def add(self, batch: Batch, blocks: Iterable[Block]) -> None:
        """Add the messages of a batch; those in no block count as undecodable."""
        good = np.zeros(len(batch), dtype=bool)
        stamps = np.zeros(len(batch), dtype=np.int64)
        accepted, decoded = [], 0
        for block in blocks:
            decoded += len(block.which)
            reason = self._defect(block)
            if reason:
                self.dropped[reason] += len(block.which)
                continue
            good[block.which] = True
            stamps[block.which] = block.stamp_ns
            accepted.append(block)
        if decoded < len(batch):
            self.dropped[UNDECODABLE] += len(batch) - decoded
        rows = len(self) + np.cumsum(good) - 1
        for block in accepted:
            self.recorded.update(block.names)
            names = self._renamed(block.names)
            self._layouts.setdefault(names, _Layout()).add(rows[block.which], block)
        self._log_ns.frombytes(np.minimum(batch.log_ns[good], _MAX_NS).astype('i8').tobytes())
        self._stamp_ns.frombytes(stamps[good].tobytes())

    def put_in_order(self, max_steps: int) -> None:
        """
        Sort the messages by log time if it goes back more than `max_steps` times.

        The file has them in any order then. A clock that is set back goes back once.
        """
        if np.count_nonzero(np.diff(self.log_ns) < 0) <= max_steps:
            return
        order = np.argsort(self.log_ns, kind='stable')
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        self._log_ns, self._stamp_ns = (
            array('q', each[order].tobytes()) for each in (self.log_ns, self.stamp_ns))
        for layout in self._layouts.values():
            layout.rows = array('q', place[np.array(layout.rows)].tobytes())

    def _defect(self, block: Block) -> str | None:
        size, names = len(block.names), self._renamed(block.names)
        if names not in self._layouts and len(set(names)) < size:
            return f'{DUPLICATE} {next(name for name in names if names.count(name) > 1)}'
        if (not size or block.position.shape[1] != size
                or block.velocity.shape[1] not in (0, size)
                or block.effort.shape[1] not in (0, size)):
            return SIZES
        return None

    def _renamed(self, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(self._rename.get(name, name) for name in names) if self._rename else names

    @property
    def names(self) -> tuple[str, ...]:
        """All joint names, in order of their first appearance."""
        return tuple(dict.fromkeys(name for layout in self._layouts for name in layout))

    @property
    def layouts(self) -> tuple[tuple[str, ...], ...]:
        """The distinct name sequences of the messages, in order of their first appearance."""
        return tuple(self._layouts)

    def names_of(self, message: int) -> tuple[str, ...]:
        """Return the joint names of message number `message`."""
        return next(names for names, layout in self._layouts.items()
                    if (np.frombuffer(layout.rows, dtype=np.int64) == message).any())

    @property
    def most_common(self) -> tuple[str, ...]:
        """The most frequent sequence of joint names."""
        return max(self._layouts, key=lambda names: len(self._layouts[names].rows))

    @property
    def log_ns(self) -> IntArray:
        return np.frombuffer(self._log_ns, dtype=np.int64)

    @property
    def stamp_ns(self) -> IntArray:
        return np.frombuffer(self._stamp_ns, dtype=np.int64)

    def presence(self, joints: Sequence[str]) -> BoolArray:
        """Return a mask (M, N): whether message m contains joint n."""
        present = np.zeros((len(self), len(joints)), dtype=bool)
        for names, layout in self._layouts.items():
            present[np.array(layout.rows)] = [joint in names for joint in joints]
        return present

    def values(self, joints: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """
        Return position, velocity and effort, each (M, N); NaN for missing values.

        If all messages have exactly these joints, the arrays are views of the columns, and no
        more messages can be added.
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
