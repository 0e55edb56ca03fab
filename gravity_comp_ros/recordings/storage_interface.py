"""Common interface of message storages of all file formats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from gravity_comp_ros.recordings.message_batch import Batch, batched


@dataclass(frozen=True)
class StoredTopic:
    """A topic of a recording: message type, encoding and number of messages."""

    name: str
    type: str
    encoding: str
    count: int


class Storage(ABC):
    """An open recording; `topics` includes topics without messages."""

    topics: tuple[StoredTopic, ...]

    @abstractmethod
    def messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """
        Yield log time in ns and bytes of every message of a topic, in order of log time.

        :raises BagError: if the file is damaged.
        """

    def batches(self, topic: str) -> Iterator[Batch]:
        """
        Yield the same messages in batches.

        :raises BagError: if the file is damaged.
        """
        return batched(self.messages(topic))

    @property
    def notes(self) -> list[str]:
        """Return sentences about what was lost while messages were read."""
        return []

    @abstractmethod
    def close(self) -> None:
        """Close the files."""


def summed(counts: Iterable[tuple[tuple[str, str, str], int]]) -> tuple[StoredTopic, ...]:
    """Return the topics, with message counts summed over equal name, type and encoding."""
    total: dict[tuple[str, str, str], int] = {}
    for key, count in counts:
        total[key] = total.get(key, 0) + count
    return tuple(StoredTopic(*key, count) for key, count in total.items())
