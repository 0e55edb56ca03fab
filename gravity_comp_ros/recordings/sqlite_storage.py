"""Message storage in the sqlite3 files (.db3) of rosbag2, with or without metadata."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
import shlex
import sqlite3
from typing import Any
from urllib.parse import quote

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.messages import Batch, batched, Storage, StoredTopic

_SELECT = ('SELECT messages.timestamp, messages.data, messages.id FROM messages JOIN topics '
           'ON messages.topic_id = topics.id WHERE topics.name = ? AND messages.id >= ? '
           'ORDER BY messages.id')
# Errors of a damaged file; its names may be no text, in the messages of sqlite too.
_FAULTS = (sqlite3.Error, UnicodeDecodeError)
# Numbers of messages are below.
_END = 2 ** 63


class SqliteStorage(Storage):
    """
    An open .db3 file, read-only; `named` is its name in messages.

    Of a damaged or truncated file, the readable messages are read, with a note.

    :raises BagError: if it is not a rosbag2 database, or is damaged.
    """

    def __init__(self, path: Path, named: Path | None = None) -> None:
        self._path = named or path
        # After a killed recording, the newest messages are in the write-ahead log, which
        # `immutable` would ignore.
        log = path.with_name(path.name + '-wal')
        immutable = '' if log.exists() and log.stat().st_size else '&immutable=1'
        try:
            self._base = sqlite3.connect(
                f'file:{quote(str(path.resolve()))}?mode=ro{immutable}', uri=True)
        except _FAULTS as error:
            raise self._unreadable(error) from None
        try:
            self.topics = self._read_topics()
        except BagError:
            self._base.close()
            raise
        except _FAULTS as error:
            self.topics = self._topics_of_part(error)

    def batches(self, topic: str) -> Iterator[Batch]:
        """Yield the messages of a topic in batches."""
        return batched(self._rows(topic))

    def _rows(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Yield log time in ns and bytes of every readable message of a topic, by number."""
        start, gap, count, damage = 0, None, 0, None
        while start < _END:
            try:
                for stamp, data, number in map(_checked, self._base.execute(
                        _SELECT, (topic, start))):
                    count += 1
                    yield stamp, data
                    start, gap = number + 1, None
                break
            except _FAULTS as error:
                # Messages of the same page are not readable either. After a damaged part, up to
                # an eighth of its number is lost, so that a long one takes few attempts.
                gap = start if gap is None else gap
                start, damage = start + 1 + (start - gap) // 8, error
        if damage is not None and not count:
            raise self._unreadable(damage) from None
        if damage is not None:
            self.notes = [f'{self._path.name} is damaged ({damage}): the {count} readable '
                          f'messages of {topic} are used']

    def close(self) -> None:
        self._base.close()

    def _read_topics(self) -> Counter[StoredTopic]:
        tables = {row[0] for row in self._base.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {'topics', 'messages'} <= tables:
            raise BagError(f'{self._path} is a database but not a recording: it has no tables '
                           f'of topics and messages')
        rows = self._base.execute('SELECT id, name, type, serialization_format FROM topics '
                                  'ORDER BY id').fetchall()
        topics: Counter[StoredTopic] = Counter()
        for number, *words in rows:
            topics[StoredTopic(*map(str, words))] += self._count(number)
        return topics

    def _topics_of_part(self, error: Exception) -> Counter[StoredTopic]:
        """Return the topics of a file that is shorter than its header says."""
        try:
            self._base.execute('PRAGMA writable_schema = ON')
            return self._read_topics()
        except (*_FAULTS, BagError):
            self._base.close()
            raise BagError(
                f'{self._path} cannot be read: the page of its tables is destroyed ({error}); '
                f'copy the file again from the recorder, or save the rows of the other pages '
                f'with `sqlite3 {shlex.quote(str(self._path))} .recover`') from None

    def _count(self, topic: int) -> int:
        """Return the number of messages of a topic; 1 if a damaged file does not give it."""
        try:
            return int(self._base.execute(
                'SELECT count(*) FROM messages WHERE topic_id = ?', (topic,)).fetchone()[0])
        except _FAULTS:
            return 1

    def _unreadable(self, error: Exception) -> BagError:
        return BagError(f'{self._path} cannot be read as a rosbag2 database: {error}')


def _checked(row: Sequence[Any]) -> tuple[int, bytes, int]:
    """Return a row; sqlite types are per value, so a damaged row may contain anything."""
    stamp, data, number = row
    return (stamp if isinstance(stamp, int) else 0, data if isinstance(data, bytes) else b'',
            number)
