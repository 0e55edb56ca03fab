"""Message storage in the sqlite3 files (.db3) of rosbag2, with or without metadata."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
import shlex
import sqlite3
from typing import Any
from urllib.parse import quote

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.messages import Batch, batched, Storage, StoredTopic

_SELECT = ('SELECT messages.timestamp, messages.data, messages.id FROM messages JOIN topics '
           'ON messages.topic_id = topics.id WHERE topics.name = ?')
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
        self._notes: list[str] = []
        # After a killed recording, the newest messages are in the write-ahead log, which
        # `immutable` would ignore.
        log = path.with_name(path.name + '-wal')
        immutable = '' if log.exists() and log.stat().st_size else '&immutable=1'
        try:
            self._base = sqlite3.connect(
                f'file:{quote(str(path.resolve()))}?mode=ro{immutable}', uri=True)
        except sqlite3.Error as error:
            raise self._unreadable(error) from None
        try:
            self.topics = self._read_topics()
        except BagError:
            self._base.close()
            raise
        except sqlite3.Error as error:
            self.topics = self._topics_of_part(error)

    @property
    def notes(self) -> list[str]:
        return self._notes

    def batches(self, topic: str) -> Iterator[Batch]:
        """Yield the messages of a topic in batches."""
        return batched(self._rows(topic))

    def _rows(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Yield log time in ns and bytes of every message of a topic, in order of arrival."""
        latest = 0
        try:
            for stamp, data, number in self._numbered(topic, 0, _END - 1):
                yield stamp, data
                latest = number
            return
        except sqlite3.Error as reason:
            error = reason
        rows = self._readable(topic)
        if not rows:
            raise self._unreadable(error) from None
        self._notes.append(f'{self._path.name} is damaged ({error}): the {len(rows)} readable '
                           f'messages of {topic} are used')
        for stamp, data, number in sorted(rows, key=lambda row: row[2]):
            if number > latest:
                yield stamp, data

    def _readable(self, topic: str) -> list[tuple[int, bytes, int]]:
        """Return stamp, data and number of all readable messages of a topic, in any order."""
        rows: list[tuple[int, bytes, int]] = []
        start, step, gap = 0, 1, None
        while start < _END:
            try:
                for row in self._numbered(topic, start, _END - 1):
                    if gap is not None:
                        rows += self._before(topic, gap, row[2])
                    rows.append(row)
                    start, step, gap = row[2] + 1, 1, None
                break
            except sqlite3.Error:
                # Messages of the same page are not readable either.
                gap = start if gap is None else gap
                start, step = start + step, 2 * step
        return rows

    def _before(self, topic: str, first: int, end: int) -> list[tuple[int, bytes, int]]:
        """Return the messages from number `end` downwards, until one is not readable."""
        rows = []
        try:
            for row in self._numbered(topic, first, end - 1, 'DESC'):
                rows.append(row)
        except sqlite3.Error:
            pass
        return rows

    def _numbered(self, topic: str, first: int, last: int, order: str = 'ASC'
                  ) -> Iterator[tuple[int, bytes, int]]:
        """Yield stamp, data and number of messages of a topic by number."""
        yield from map(_checked, self._base.execute(
            f'{_SELECT} AND messages.id BETWEEN ? AND ? ORDER BY messages.id {order}',
            (topic, first, last)))

    def close(self) -> None:
        self._base.close()

    def _read_topics(self) -> tuple[StoredTopic, ...]:
        tables = {row[0] for row in self._base.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {'topics', 'messages'} <= tables:
            raise BagError(f'{self._path} is a database but not a recording: it has no tables '
                           f'of topics and messages')
        rows = self._base.execute('SELECT id, name, type, serialization_format FROM topics '
                                  'ORDER BY id').fetchall()
        return tuple(StoredTopic(str(name), str(kind), str(encoding), self._count(number))
                     for number, name, kind, encoding in rows)

    def _topics_of_part(self, error: sqlite3.Error) -> tuple[StoredTopic, ...]:
        """Return the topics of a file that is shorter than its header says."""
        try:
            self._base.execute('PRAGMA writable_schema = ON')
            return self._read_topics()
        except (sqlite3.Error, BagError):
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
        except sqlite3.DatabaseError:
            return 1

    def _unreadable(self, error: sqlite3.Error) -> BagError:
        return BagError(f'{self._path} cannot be read as a rosbag2 database: {error}')


def _checked(row: Sequence[Any]) -> tuple[int, bytes, int]:
    """Return a row; sqlite types are per value, so a damaged row may contain anything."""
    stamp, data, number = row
    return (stamp if isinstance(stamp, int) else 0, data if isinstance(data, bytes) else b'',
            number)
