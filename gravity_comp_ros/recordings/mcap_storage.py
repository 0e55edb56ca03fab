"""
Message storage in MCAP files.

The messages of a chunk are located in its bytes and stay there, as one batch. A file without an
index of its chunks is read record by record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
import struct
import zlib

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.messages import (
    Batch, batched, Bytes, decompressed, Places, Storage, StoredTopic)
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk, CRCValidationError, StreamReader
from mcap.summary import Summary
import numpy as np

MAGIC = b'\x89MCAP0\r\n'
_END = 1 + 8 + 8 + 8 + 4 + len(MAGIC)       # footer: opcode, length, starts, checksum; magic
_RECORD = struct.Struct('<BQ')              # opcode and length, before the content
_MESSAGE_HEAD = 2 + 4 + 8 + 8               # channel, sequence, log time, publish time
_MAX_BYTES = 1 << 30


class ChunkError(ValueError):
    """A chunk is damaged or not supported; the message gives the reason."""


class McapStorage(Storage):
    """
    An open MCAP file; `named` is its name in messages.

    Of a damaged or truncated file, as of a recorder that was killed, the readable messages are
    read, with a note.

    :raises BagError: if no message can be read.
    """

    def __init__(self, path: Path, named: Path | None = None) -> None:
        self._path, self._file = named or path, path
        self._damage: Exception | None = None
        self._stream = path.open('rb')
        try:
            self._summary = self._read_summary()
            self.topics = _topics(self._summary) if self._summary else Counter(
                topic for topic, _ in self._messages())
            if self._damage and not self.topics:
                raise self._unreadable()
        except BagError:
            self._stream.close()
            raise

    def batches(self, topic: str) -> Iterator[Batch]:
        """Yield the messages of a topic in batches; whole chunks if the file has an index."""
        count = 0
        for batch in self._batches(topic):
            count += len(batch)
            yield batch
        if self._damage and not count:
            raise self._unreadable()
        if self._damage:
            self.notes = [f'{self._path.name} is damaged ({_reason(self._damage)}): the {count} '
                          f'readable messages of {topic} are used']

    def _batches(self, topic: str) -> Iterator[Batch]:
        if self._summary is None or not self._summary.chunk_indexes:
            yield from batched((message.log_time, message.data) for of, message
                               in self._messages() if of.name == topic)
            return
        known = self._summary.channels
        selected = {number for number, channel in known.items() if channel.topic == topic}
        for index in sorted(self._summary.chunk_indexes, key=lambda each: each.chunk_start_offset):
            if not index.message_index_offsets or selected & set(index.message_index_offsets):
                try:
                    chunk = self._record(index.chunk_start_offset)
                    if not isinstance(chunk, Chunk):
                        raise ChunkError('there is no chunk at an offset given by the summary')
                    batch = _located(_plain(chunk), set(known), selected)
                except Exception as error:  # the library raises various types for damaged files
                    self._damage = error
                    continue
                if len(batch):
                    yield batch

    def _messages(self) -> Iterator[tuple[StoredTopic, Message]]:
        """
        Yield the topic of each message before the damage, and the message, in file order.

        :raises BagError: if the checksum of all of them is wrong.
        """
        try:
            yield from _messages(self._file)
        except Exception as error:  # the library raises various types for damaged files
            self._damage = self._damage or error
            if isinstance(error, CRCValidationError):
                raise self._unreadable() from None

    def _record(self, offset: int) -> McapRecord:
        self._stream.seek(offset)
        return next(StreamReader(self._stream, skip_magic=True, emit_chunks=True,
                                 record_size_limit=_MAX_BYTES).records)

    def close(self) -> None:
        self._stream.close()

    def _read_summary(self) -> Summary | None:
        """Return the summary, None if the file has none, or no footer or a wrong checksum."""
        size = self._stream.seek(0, 2)
        try:
            footer = self._record(size - _END)
            if not isinstance(footer, Footer) or self._stream.read() != MAGIC:
                raise ValueError
        except Exception:  # the library raises various types for damaged files
            self._damage = ChunkError(f'it is truncated: it stops after {size} bytes without an '
                                      f'end')
            return None
        try:
            if footer.summary_start and footer.summary_crc:
                self._stream.seek(footer.summary_start)
                # The checksum is that of all bytes before itself.
                if zlib.crc32(self._stream.read()[:-len(MAGIC) - 4]) != footer.summary_crc:
                    raise ChunkError('the checksum of its summary is wrong')
            self._stream.seek(0)
            return SeekingReader(self._stream, record_size_limit=_MAX_BYTES).get_summary()
        except Exception as error:  # the library raises various types for damaged files
            self._damage = error
            return None

    def _unreadable(self) -> BagError:
        return BagError(f'{self._path} is damaged: {_reason(self._damage)}; no message in it can '
                        f'be read')


def _reason(error: Exception | None) -> str:
    return ' '.join(str(error).split()) or type(error).__name__


def _topics(summary: Summary) -> Counter[StoredTopic]:
    counts = summary.statistics.channel_message_counts if summary.statistics else {}
    topics: Counter[StoredTopic] = Counter()
    for channel in summary.channels.values():
        topics[_topic(channel, summary.schemas)] += counts.get(channel.id, 0)
    return topics


def _topic(channel: Channel, schemas: Mapping[int, Schema]) -> StoredTopic:
    schema = schemas.get(channel.schema_id)
    return StoredTopic(channel.topic, schema.name if schema else '', channel.message_encoding)


def _messages(path: Path) -> Iterator[tuple[StoredTopic, Message]]:
    """Yield the topic of each message of a file, and the message, in file order."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with path.open('rb') as stream:
        for whole in StreamReader(stream, emit_chunks=True, validate_crcs=True,
                                  record_size_limit=_MAX_BYTES).records:
            parts = [whole]
            if isinstance(whole, Chunk):
                whole.data, whole.compression = _plain(whole), ''
                parts = breakup_chunk(whole)
            for record in parts:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    _check_channels({record.channel_id}, channels)
                    yield _topic(channels[record.channel_id], schemas), record


def _plain(chunk: Chunk) -> bytes:
    """
    Return the records of a chunk, decompressed up to its size.

    :raises ChunkError: if they are not those that the chunk declares.
    :raises CompressionError: if they cannot be decompressed.
    """
    size = min(chunk.uncompressed_size, _MAX_BYTES)
    data = decompressed(chunk.data, chunk.compression, size) if chunk.compression else chunk.data
    if len(data) < chunk.uncompressed_size:
        raise ChunkError('a chunk is shorter than its size')
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ChunkError('the checksum of a chunk is wrong')
    return data


def _located(data: bytes, known: Collection[int], channels: Collection[int]) -> Batch:
    """
    Return the messages of a chunk on some channels.

    :param known: all channels of the file; a message on another one indicates damage.
    """
    places, at, last = [], 0, len(data) - _RECORD.size
    unpack, head = _RECORD.unpack_from, _RECORD.size  # faster as local names
    while at <= last:
        opcode, length = unpack(data, at)
        if opcode == Opcode.MESSAGE:
            places.append(at)
        at += head + length
    if at != len(data):
        raise ChunkError('a record ends after its chunk')
    buffer, place = np.frombuffer(data, dtype=np.uint8), np.array(places, dtype=np.int64)
    size = _field(buffer, place + 1, 8).astype(np.int64) - _MESSAGE_HEAD
    if (size < 0).any():
        raise ChunkError('a message is too short')
    begin = place + head
    channel = _field(buffer, begin, 2)
    _check_channels(set(np.unique(channel).tolist()), known)
    keep = np.isin(channel, list(channels))
    return Batch(buffer, (begin + _MESSAGE_HEAD)[keep], size[keep],
                 _field(buffer, begin + 6, 8)[keep])


def _check_channels(used: set[int], known: Collection[int]) -> None:
    unknown = used - set(known)
    if unknown:
        raise ChunkError(f'a message is on channel {min(unknown)}, which is not described')


def _field(data: Bytes, place: Places, width: int) -> np.ndarray:
    """Return the little-endian unsigned integers of `width` bytes at these places."""
    return data[place[:, None] + np.arange(width)].view(f'<u{width}')[:, 0]
