"""Message storage in the sqlite3 files (.db3) of rosbag2, with or without metadata."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import sqlite3
from urllib.parse import quote

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.storage_interface import Storage, StoredTopic


class SqliteStorage(Storage):
    """
    An open .db3 file, read-only.

    :raises BagError: if it is not a rosbag2 database, or is damaged.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
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

    def messages(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Yield log time in ns and bytes of every message of a topic."""
        try:
            rows = self._base.execute(
                'SELECT messages.timestamp, messages.data FROM messages JOIN topics '
                'ON messages.topic_id = topics.id WHERE topics.name = ? '
                'ORDER BY messages.timestamp, messages.id', (topic,))
            for stamp, data in rows:
                # sqlite types are per value, so that a damaged row may contain anything.
                yield (stamp if isinstance(stamp, int) else 0,
                       data if isinstance(data, bytes) else b'')
        except sqlite3.Error as error:
            raise self._unreadable(error) from None

    def close(self) -> None:
        self._base.close()

    def _read_topics(self) -> tuple[StoredTopic, ...]:
        tables = {row[0] for row in self._base.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {'topics', 'messages'} <= tables:
            raise BagError(f'{self._path} is a database but not a recording: it has no tables '
                           f'of topics and messages')
        rows = self._base.execute(
            'SELECT name, type, serialization_format, '
            '(SELECT count(*) FROM messages WHERE topic_id = topics.id) FROM topics '
            'ORDER BY id').fetchall()
        return tuple(StoredTopic(str(name), str(kind), str(encoding), int(count))
                     for name, kind, encoding, count in rows)

    def _unreadable(self, error: sqlite3.Error) -> BagError:
        return BagError(f'{self._path} cannot be read as a rosbag2 database: {error}')
