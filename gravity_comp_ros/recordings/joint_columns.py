"""Columns of position, velocity and effort by joint, gathered from the messages of a topic."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.recordings.joint_state_cdr import Block, decode, ROS1
from gravity_comp_ros.recordings.messages import Batch, Storage
import numpy as np

UNDECODABLE = 'not decodable'
DUPLICATE = 'duplicate joint name'

_MAX_NS = 2**63 - 1
# Multiples of the golden ratio, modulo 1, are evenly distributed in the unit interval.
_GOLDEN = (5.0 ** 0.5 - 1.0) / 2.0


class Columns:
    """
    Valid messages of a topic in recorded order, and the number of invalid ones by reason.

    `log_ns` and `stamp_ns` (M,) are log times and stamps. `recorded` are the names of joints
    before they were renamed.

    :param rename: new names of joints, by the name in the messages.
    :param share: share of the messages to use, evenly distributed.
    """

    def __init__(self, storage: Storage, topic: str, rename: Mapping[str, str] | None = None,
                 share: float = 1.0) -> None:
        self.dropped: Counter[str] = Counter()
        self.recorded: set[str] = set()
        self._rename = dict(rename or {})
        # Numbers of the messages with each sequence of names, and their values, which grow in
        # place: 24 bytes per joint and message.
        self._rows: dict[tuple[str, ...], list[IntArray]] = {}
        self._values: dict[tuple[str, ...], tuple[array, array, array]] = {}
        ros1 = any((each.type, each.encoding) == ROS1 for each in storage.topics
                   if each.name == topic)
        times, count, valid = [np.zeros((2, 0), dtype=np.int64)], 0, 0
        for batch in storage.batches(topic):
            count += len(batch)
            if share < 1.0:
                # Every k-th message could select one of several alternating publishers.
                batch = batch.select(np.arange(count - len(batch), count) * _GOLDEN % 1.0 < share)
            times.append(self._add(batch, decode(batch, ros1), valid))
            valid += times[-1].shape[1]
        self.log_ns, self.stamp_ns = np.concatenate(times, axis=1)

    def __len__(self) -> int:
        return len(self.log_ns)

    def _add(self, batch: Batch, blocks: Iterable[Block], first: int) -> IntArray:
        """
        Add the valid messages of a batch; those in no block count as undecodable.

        :param first: number of its first valid message.
        :return: log times and stamps (2, M) of the valid ones, ns.
        """
        accepted = []
        stamps = np.zeros(len(batch), dtype=np.int64)
        good, decoded = np.zeros((2, len(batch)), dtype=bool)
        for block in blocks:
            decoded[block.which] = True
            names = tuple(self._rename.get(name, name) for name in block.names)
            reason = _defect(block, names)
            if reason:
                self.dropped[reason] += len(block.which)
                continue
            good[block.which] = True
            stamps[block.which] = block.stamp_ns
            self.recorded.update(block.names)
            accepted.append((names, block.which))
            stores = self._values.setdefault(names, (array('d'), array('d'), array('d')))
            for store, values in zip(stores, (block.position, block.velocity, block.effort)):
                missing = np.full((len(values), len(names)), np.nan)
                store.frombytes((values if values.shape[1] else missing).tobytes())
        self.dropped += Counter({UNDECODABLE: int((~decoded).sum())})
        numbers = first + np.cumsum(good) - 1
        for names, which in accepted:
            self._rows.setdefault(names, []).append(numbers[which])
        return np.stack([np.minimum(batch.log_ns, _MAX_NS).astype(np.int64), stamps])[:, good]

    def put_in_order(self, max_steps: int) -> None:
        """
        Sort the messages by log time if it goes back more than `max_steps` times.

        The file has them in any order then. A clock that is set back goes back once.
        """
        if np.count_nonzero(np.diff(self.log_ns) < 0) <= max_steps:
            return
        order = np.argsort(self.log_ns, kind='stable')
        place = np.argsort(order)
        self.log_ns, self.stamp_ns = self.log_ns[order], self.stamp_ns[order]
        self._rows = {names: [place[np.concatenate(rows)]] for names, rows in self._rows.items()}

    @property
    def names(self) -> tuple[str, ...]:
        """All joint names, in order of their first appearance."""
        return tuple(dict.fromkeys(name for layout in self._rows for name in layout))

    @property
    def layouts(self) -> dict[tuple[str, ...], int]:
        """The distinct name sequences, in order of first appearance, and their messages."""
        return {names: sum(map(len, rows)) for names, rows in self._rows.items()}

    def is_successive(self) -> bool:
        """Return whether each name sequence appears after all messages of those before it."""
        spans = [(rows[0][0], rows[-1][-1]) for rows in self._rows.values()]
        return all(end < start for (_, end), (start, _) in zip(spans, spans[1:]))

    def names_of(self, message: int) -> tuple[str, ...]:
        """Return the joint names of message number `message`."""
        return next(names for names, rows in self._rows.items()
                    if any(message in part for part in rows))

    def presence(self, joints: Sequence[str]) -> BoolArray:
        """Return a mask (M, N): whether message m contains joint n."""
        present = np.zeros((len(self), len(joints)), dtype=bool)
        for names, rows in self._rows.items():
            present[np.concatenate(rows)] = [joint in names for joint in joints]
        return present

    def values(self, joints: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """
        Return position, velocity and effort, each (M, N); NaN for missing values.

        If all messages have exactly these joints, in order, the arrays are views.
        """
        shape = (len(self), len(joints))
        out = [np.empty(shape) for _ in range(3)]
        for names, parts in self._rows.items():
            rows = np.concatenate(parts)
            stored = [np.frombuffer(flat).reshape(-1, len(names)) for flat in self._values[names]]
            if names == tuple(joints) and len(rows) == len(self) and (np.diff(rows) > 0).all():
                out = stored
                break
            target = [k for k, joint in enumerate(joints) if joint in names]
            source = [names.index(joints[k]) for k in target]
            for table, values in zip(out, stored):
                table[rows] = np.nan
                table[rows[:, None], target] = values[:, source]
        return out[0], out[1], out[2]


def _defect(block: Block, names: tuple[str, ...]) -> str | None:
    size = len(names)
    if len(set(names)) < size:
        return f'{DUPLICATE} {next(name for name in names if names.count(name) > 1)}'
    for what in ('position', 'velocity', 'effort'):
        count = getattr(block, what).shape[1]
        if count not in (0, size) or not size or what == 'position' and not count:
            return f'with {count} values of {what} for {size} joints'
    return None
