"""Message storage in MCAP files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import struct
import zlib

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.compression import decompressed
from gravity_comp_ros.recordings.mcap_chunks import ChunkError, message_offsets, topic_batches
from gravity_comp_ros.recordings.messages import Batch, batched, Storage, StoredTopic, summed
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Footer, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

_MAGIC = b'\x89MCAP0\r\n'
_FOOTER = 1 + 8 + 8 + 8 + 4  # opcode, length, summary start, summary offsets, checksum
_MAX_RECORD = 1 << 30


class McapStorage(Storage):
    """
    An open MCAP file with a footer and a summary; `named` is its name in messages.

    :raises BagError: if the file is truncated or damaged; the message gives the number of
        readable messages.
    """

    def __init__(self, path: Path, named: Path | None = None) -> None:
        self._path, self._file = named or path, path
        self._stream = path.open('rb')
        try:
            self._check_end()
            self._reader = SeekingReader(self._stream, validate_crcs=True,
                                         record_size_limit=_MAX_RECORD)
            self._summary = self._reader.get_summary()
            self.topics = _topics(self._summary) if self._summary else self._scan()
        except BagError:
            self._stream.close()
            raise
        except Exception as error:  # the library raises various types for damaged files
            self._stream.close()
            raise self._damaged(error) from None

    def batches(self, topic: str) -> Iterator[Batch]:
        """Yield the messages of a topic in batches; whole chunks if the file has chunks."""
        if self._summary is None or not self._summary.chunk_indexes:
            yield from batched(self._scanned(topic))
            return
        channels = self._summary.channels
        selected = {number for number, channel in channels.items() if channel.topic == topic}
        try:
            yield from topic_batches(self._stream, self._summary.chunk_indexes, set(channels),
                                     selected)
        except (ChunkError, OSError, struct.error) as error:
            raise self._damaged(error) from None

    def _scanned(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Yield the messages of a topic of a file without an index of chunks."""
        try:
            _check_chunks(self._file)
            for _, _, message in self._reader.iter_messages(topic, log_time_order=False):
                yield message.log_time, message.data
        except Exception as error:
            raise self._damaged(error) from None

    def close(self) -> None:
        self._stream.close()

    def _check_end(self) -> None:
        """Refuse a file without footer, or with a wrong checksum of the summary."""
        size = self._stream.seek(0, 2)
        if size < 2 * len(_MAGIC) + _FOOTER:
            raise self._truncated(size)
        self._stream.seek(size - len(_MAGIC) - _FOOTER)
        tail = self._stream.read()
        if tail[-len(_MAGIC):] != _MAGIC or tail[0] != 2:
            raise self._truncated(size)
        start = int.from_bytes(tail[9:17], 'little')
        checksum = int.from_bytes(tail[25:29], 'little')
        if start and checksum:
            self._stream.seek(start)
            summary = self._stream.read(size - len(_MAGIC) - 4 - start)
            if zlib.crc32(summary) != checksum:
                raise BagError(f'{self._path} is damaged: the checksum of its summary is wrong; '
                               f'`mcap recover` saves the readable part')
        self._stream.seek(0)

    def _scan(self) -> tuple[StoredTopic, ...]:
        """Return the topics of a file without summary, from all its messages."""
        _check_chunks(self._file)
        self._stream.seek(0)
        topics = summed((_key(channel, schema), 1) for schema, channel, _ in
                        SeekingReader(self._stream).iter_messages())
        self._stream.seek(0)
        return topics

    def _truncated(self, size: int) -> BagError:
        readable = _readable_messages(self._file)
        advice = (f'its first {readable} messages can be saved with `mcap recover`' if readable
                  else 'no message in it can be read')
        return BagError(f'{self._path} is truncated: the file stops after {size} bytes without '
                        f'an end; {advice}')

    def _damaged(self, error: Exception) -> BagError:
        reason = ' '.join(str(error).split()) or type(error).__name__
        return BagError(f'{self._path} is damaged: {reason}; `mcap recover` saves the readable '
                        f'part')


def _check_chunks(path: Path) -> None:
    """
    Check the size of every chunk, which the library does not.

    :raises CompressionError: if a chunk expands to more than its size.
    """
    with path.open('rb') as stream:
        for record in StreamReader(stream, emit_chunks=True,
                                   record_size_limit=_MAX_RECORD).records:
            if isinstance(record, Chunk):
                _plain(record)


def _topics(summary: Summary) -> tuple[StoredTopic, ...]:
    counts = summary.statistics.channel_message_counts if summary.statistics else {}
    return summed((_key(channel, summary.schemas.get(channel.schema_id)),
                   counts.get(channel.id, 0)) for channel in summary.channels.values())


def _key(channel: Channel, schema: Schema | None) -> tuple[str, str, str]:
    return channel.topic, schema.name if schema else '', channel.message_encoding


def _readable_messages(path: Path) -> int:
    """Return the number of messages before the damage."""
    count = 0
    try:
        with path.open('rb') as stream:
            for record in StreamReader(stream, emit_chunks=True,
                                       record_size_limit=_MAX_RECORD).records:
                count += isinstance(record, Message)
                if isinstance(record, Chunk):
                    count += len(message_offsets(_plain(record)))
                if isinstance(record, Footer):
                    break
    except Exception:  # the library raises various types for damaged files
        return count
    return count


def _plain(chunk: Chunk) -> bytes:
    """Return the records of a chunk, decompressed up to its size."""
    size = min(chunk.uncompressed_size, _MAX_RECORD)
    return decompressed(chunk.data, chunk.compression, size) if chunk.compression else chunk.data
