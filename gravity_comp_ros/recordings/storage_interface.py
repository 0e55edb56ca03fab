"""What every storage of messages offers, whatever its file format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from gravity_comp_ros.recordings.message_batch import Batch, batched


@dataclass(frozen=True)
class StoredTopic:
    """A topic of a recording: its type, the encoding of its messages, and their number."""

    name: str
    type: str
    encoding: str
    count: int


class Storage(ABC):
    """An open recording; `topics` are all, those without messages included."""

    topics: tuple[StoredTopic, ...]

    @abstractmethod
    def messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """
        Yield log time in ns and bytes of every message of a topic, in order of log time.

        :raises BagError: if the file turns out to be damaged.
        """

    def batches(self, topic: str) -> Iterator[Batch]:
        """
        Yield the same messages many at a time.

        :raises BagError: if the file turns out to be damaged.
        """
        return batched(self.messages(topic))

    @abstractmethod
    def close(self) -> None:
        """Close the files."""


def summed(counts: Iterable[tuple[tuple[str, str, str], int]]) -> tuple[StoredTopic, ...]:
    """Return topics from numbers of messages by name, type and encoding; equal ones are one."""
    found: dict[tuple[str, str, str], int] = {}
    for key, count in counts:
        found[key] = found.get(key, 0) + count
    return tuple(StoredTopic(*key, count) for key, count in found.items())
