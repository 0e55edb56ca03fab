"""Message storage in the sqlite3 files (.db3) of rosbag2, with or without metadata."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
import sqlite3
from urllib.parse import quote

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.messages import Batch, batched, Storage, StoredTopic

_SELECT = ('SELECT messages.timestamp, messages.data FROM messages JOIN topics '
           'ON messages.topic_id = topics.id WHERE topics.name = ?')


class SqliteStorage(Storage):
    """
    An open .db3 file, read-only; `named` is its name in messages.

    Of a damaged file, the readable messages before and after the damage are read, with a note.

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
        except (sqlite3.Error, BagError) as error:
            self._base.close()
            raise error if isinstance(error, BagError) else self._unreadable(error) from None

    @property
    def notes(self) -> list[str]:
        return self._notes

    def batches(self, topic: str) -> Iterator[Batch]:
        """Yield the messages of a topic in batches."""
        return batched(self._rows(topic))

    def _rows(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Yield log time in ns and bytes of every message of a topic."""
        try:
            rows = self._base.execute(
                f'{_SELECT} ORDER BY messages.timestamp, messages.id', (topic,))
            first = rows.fetchone()
        except sqlite3.Error as error:
            yield from self._readable_part(topic, error)
            return
        try:
            while first is not None:
                yield _checked(first)
                first = rows.fetchone()
        except sqlite3.Error as error:
            raise self._unreadable(error) from None

    def _readable_part(self, topic: str, error: sqlite3.Error) -> Iterator[tuple[int, bytes]]:
        """Yield the messages from either end up to the damage, in order of time."""
        rows: dict[int, tuple[int, bytes]] = {}
        for order in ('ASC', 'DESC'):
            try:
                for number, *row in self._base.execute(
                        _SELECT.replace('SELECT', 'SELECT messages.id,', 1)
                        + f' ORDER BY messages.id {order}', (topic,)):
                    if number in rows:
                        break
                    rows[number] = _checked(row)
            except sqlite3.Error:
                continue
        if not rows:
            raise self._unreadable(error) from None
        self._notes.append(f'{self._path.name} is damaged ({error}): the {len(rows)} readable '
                           f'messages of {topic} are used')
        yield from sorted(rows.values(), key=lambda row: row[0])

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

    def _count(self, topic: int) -> int:
        """Return the number of messages of a topic; 1 if a damaged file does not give it."""
        try:
            return int(self._base.execute(
                'SELECT count(*) FROM messages WHERE topic_id = ?', (topic,)).fetchone()[0])
        except sqlite3.DatabaseError:
            return 1

    def _unreadable(self, error: sqlite3.Error) -> BagError:
        return BagError(f'{self._path} cannot be read as a rosbag2 database: {error}')


def _checked(row: Sequence[object]) -> tuple[int, bytes]:
    """Return stamp and data; sqlite types are per value, so a damaged row may contain anything."""
    stamp, data = row
    return stamp if isinstance(stamp, int) else 0, data if isinstance(data, bytes) else b''
