"""
Chunks of an MCAP file: decompression, verification and location of the messages of a topic.

A chunk is followed by an index of its messages, by channel. The index is used only if it covers
all messages of the chunk. Otherwise the records are scanned one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import struct
from typing import BinaryIO
import zlib

from gravity_comp_ros.recordings.compression import CompressionError, decompressed
from gravity_comp_ros.recordings.messages import Batch, Bytes, Places
from mcap.records import ChunkIndex
import numpy as np

CHUNK, MESSAGE, MESSAGE_INDEX = 0x06, 0x05, 0x07
_RECORD = struct.Struct('<BQ')              # opcode and length, before the content
_CHUNK = struct.Struct('<QQQI')             # start, end, uncompressed size, checksum
_MESSAGE = 2 + 4 + 8 + 8                    # channel, sequence, log time, publish time
_MAX_BYTES = 1 << 30


class ChunkError(ValueError):
    """A chunk is damaged or not supported; the message gives the reason."""


@dataclass(frozen=True, eq=False)
class _Chunk:
    """The bytes of a chunk, and its messages in file order."""

    data: Bytes
    offset: Places
    log_ns: np.ndarray
    channel: np.ndarray
    length: Places


def topic_batches(stream: BinaryIO, indexes: Sequence[ChunkIndex], known: set[int],
                  channels: set[int]) -> Iterator[Batch]:
    """
    Yield the messages of channels `channels`, chunk by chunk, in file order.

    :param known: all channels of the file; a message on another channel indicates damage.
    :raises ChunkError: if a chunk is damaged.
    """
    selected = [index for index in indexes if not index.message_index_offsets
                or channels & set(index.message_index_offsets)]
    for index in sorted(selected, key=lambda each: each.chunk_start_offset):
        batch = _select(_read(stream, index, known), channels)
        if len(batch):
            yield batch


def _read(stream: BinaryIO, index: ChunkIndex, known: set[int]) -> _Chunk:
    stream.seek(index.chunk_start_offset)
    head = stream.read(_RECORD.size + _CHUNK.size + 4)
    if len(head) < _RECORD.size + _CHUNK.size + 4 or head[0] != CHUNK:
        raise ChunkError('there is no chunk at an offset given by the summary')
    length = _RECORD.unpack_from(head)[1]
    _, _, size, checksum = _CHUNK.unpack_from(head, _RECORD.size)
    (name,) = struct.unpack_from('<I', head, len(head) - 4)
    rest = length - _CHUNK.size - 4
    if not name + 8 <= rest <= _MAX_BYTES or size > _MAX_BYTES:
        raise ChunkError('the length of a chunk is wrong')
    body = stream.read(rest)
    (packed,) = struct.unpack_from('<Q', body, name) if len(body) >= name + 8 else (-1,)
    if packed < 0 or len(body) < name + 8 + packed:
        raise ChunkError('a chunk ends after the file')
    data = _decompressed(body[name + 8:name + 8 + packed], bytes(body[:name]), size)
    if checksum and zlib.crc32(data) != checksum:
        raise ChunkError('the checksum of a chunk is wrong')
    buffer = np.frombuffer(data, dtype=np.uint8)
    offset = _indexed_offsets(stream, index, buffer)
    if offset is None:
        offset = message_offsets(data)
    return _chunk(buffer, offset, known)


def _decompressed(body: bytes, compression: bytes, size: int) -> bytes:
    if not compression:
        return body
    if compression not in (b'zstd', b'lz4'):
        raise ChunkError(f'compression {compression.decode(errors="replace")!r} is unknown')
    try:
        data = decompressed(body, compression.decode(), size)
    except CompressionError as error:
        raise ChunkError(str(error)) from None
    if len(data) < size:
        raise ChunkError('a chunk is shorter than its size')
    return data


def _indexed_offsets(stream: BinaryIO, index: ChunkIndex, data: Bytes) -> Places | None:
    """Return the offsets of the messages from the index after the chunk; None if it is invalid."""
    if not index.message_index_offsets:
        return None
    stream.seek(index.chunk_start_offset + index.chunk_length)
    raw = stream.read(min(index.message_index_length, _MAX_BYTES))
    offsets, at = [], 0
    while at + _RECORD.size + 6 <= len(raw):
        opcode, length = _RECORD.unpack_from(raw, at)
        (size,) = struct.unpack_from('<I', raw, at + _RECORD.size + 2)
        at += _RECORD.size
        if opcode != MESSAGE_INDEX or size % 16 or size + 6 > length or at + length > len(raw):
            return None
        offsets.append(np.frombuffer(raw, dtype='<u8', count=size // 8, offset=at + 6)[1::2])
        at += length
    if at != len(raw) or not offsets:
        return None
    offset = np.sort(np.concatenate(offsets))
    if not offset.size or offset[-1] + _RECORD.size + _MESSAGE > len(data):
        return None
    offset = offset.astype(np.int64)
    return offset if _is_complete(data, offset) else None


def _is_complete(data: Bytes, offset: Places) -> bool:
    """Return whether these are all messages of a chunk; other records may lie between them."""
    if (data[offset] != MESSAGE).any():
        return False
    end = offset + _RECORD.size + _field(data, offset + 1, 8).astype(np.int64)
    begin = np.concatenate([[0], end])
    until = np.concatenate([offset, [len(data)]])
    if (begin > until).any():
        return False
    try:
        return not any(message_offsets(data[a:b].tobytes()).size
                       for a, b in zip(begin[begin < until], until[begin < until]))
    except ChunkError:
        return False


def message_offsets(data: bytes) -> Places:
    """Return the offsets of the messages among consecutive records."""
    offsets, begin, end = [], 0, len(data)
    while begin < end:
        if begin + _RECORD.size > end:
            raise ChunkError('a record ends after its chunk')
        opcode, length = _RECORD.unpack_from(data, begin)
        if opcode == MESSAGE:
            offsets.append(begin)
        begin += _RECORD.size + length
    if begin != end:
        raise ChunkError('a record ends after its chunk')
    return np.array(offsets, dtype=np.int64)


def _chunk(data: Bytes, offset: Places, known: set[int]) -> _Chunk:
    length = _field(data, offset + 1, 8).astype(np.int64) - _MESSAGE
    if (length < 0).any():
        raise ChunkError('a message is too short')
    channel = _field(data, offset + _RECORD.size, 2)
    unknown = set(np.unique(channel).tolist()) - known
    if unknown:
        raise ChunkError(f'a message is on channel {min(unknown)}, which is not described')
    return _Chunk(data, offset, _field(data, offset + _RECORD.size + 6, 8), channel, length)


def _select(chunk: _Chunk, channels: set[int]) -> Batch:
    start = chunk.offset + _RECORD.size + _MESSAGE
    keep = np.isin(chunk.channel, list(channels))
    if keep.all():
        return Batch(chunk.data, start, chunk.length, chunk.log_ns)
    return Batch(chunk.data, start[keep], chunk.length[keep], chunk.log_ns[keep])


def _field(data: Bytes, offset: Places, width: int) -> np.ndarray:
    """Return the little-endian unsigned integers of `width` bytes at these offsets."""
    return data[offset[:, None] + np.arange(width)].view(f'<u{width}')[:, 0]
