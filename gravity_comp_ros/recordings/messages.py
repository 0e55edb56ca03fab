"""Stored messages: topics and batches of messages, common to all file formats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]
Times = NDArray[np.uint64]

_BATCH_SIZE = 4096


@dataclass(frozen=True)
class Batch:
    """
    M messages in file order: message m is `data[start[m]:start[m] + length[m]]`.

    `log_ns` (M,) is the log time in ns. Bytes of `data` between the messages belong to other
    topics.
    """

    data: Bytes
    start: Places
    length: Places
    log_ns: Times

    def __len__(self) -> int:
        return len(self.start)

    def select(self, which: NDArray[np.bool_]) -> Batch:
        """Return the messages selected by a mask (M,)."""
        return Batch(self.data, self.start[which], self.length[which], self.log_ns[which])

    def message(self, m: int) -> bytes:
        """Return the bytes of message m."""
        return self.data[self.start[m]:self.start[m] + self.length[m]].tobytes()

    def rows(self, which: Places, length: int) -> Bytes:
        """
        Return messages of equal length as a matrix, shape (len(which), length).

        Equidistant messages, as in a chunk of one topic, are returned as a view.
        """
        start = self.start[which]
        step = int(start[1] - start[0]) if len(start) > 1 else length
        if step > 0 and (np.diff(start) == step).all():
            return np.lib.stride_tricks.as_strided(
                self.data[start[0]:], (len(start), length), (step, 1), writeable=False)
        return self.data[start[:, None] + np.arange(length)]


def batched(messages: Iterator[tuple[int, bytes]]) -> Iterator[Batch]:
    """Gather single messages, given as log time in ns and bytes, into batches."""
    while part := list(islice(messages, _BATCH_SIZE)):
        length = np.array([len(data) for _, data in part], dtype=np.int64)
        # A damaged row may contain any number.
        log_ns = np.array([min(max(ns, 0), 2**64 - 1) for ns, _ in part], dtype=np.uint64)
        yield Batch(np.frombuffer(b''.join(data for _, data in part), dtype=np.uint8),
                    np.cumsum(length) - length, length, log_ns)


class StoredTopic(NamedTuple):
    """A topic of a recording: name, message type and encoding."""

    name: str
    type: str
    encoding: str


class Storage(ABC):
    """
    An open recording.

    `topics` has the number of messages of each topic, which may be 0. `notes` are sentences about
    what was lost while messages were read.
    """

    topics: Counter[StoredTopic]
    notes: Sequence[str] = ()

    @abstractmethod
    def batches(self, topic: str) -> Iterator[Batch]:
        """
        Yield the messages of a topic in batches, in the order of the file.

        It is that of their arrival, also where the clock of the recorder was set back.

        :raises BagError: if the file is damaged.
        """

    def close(self) -> None:  # noqa: B027
        """Close the files, if this object has opened any."""
