"""
Decompression within a limit of size.

The declared size of compressed data may be wrong: two kilobytes of zstd can declare 10 bytes and
expand to gigabytes. Nothing beyond the limit is decompressed.
"""

from __future__ import annotations

from pathlib import Path

from gravity_comp_ros.errors import BagError

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
# Bytes. A joint state of a thousand joints has less than 0.1 MB.
MAX_MESSAGE = 1 << 24
# Bytes, and times the size of the file: messages of joint states compress to a tenth.
_MAX_FILE, _MAX_RATIO = 1 << 32, 100
# Bytes read at a time: one block expands to 0.13 GB at most.
_BLOCK = 1 << 12


class CompressionError(ValueError):
    """Compressed data that are damaged, truncated or too large; the message gives the reason."""


def decompressed(data: bytes, kind: str, limit: int) -> bytes:
    """
    Return decompressed data.

    :param limit: maximum size in bytes.
    :raises CompressionError: if `kind` is not 'zstd' or 'lz4', or the data are damaged, truncated
        or larger.
    """
    import zstandard
    try:
        if kind == 'zstd':
            with zstandard.ZstdDecompressor().stream_reader(
                    data, read_across_frames=True) as reader:
                out = reader.read(limit + 1)
        elif kind == 'lz4':
            import lz4.frame  # type: ignore[import-untyped]
            out = bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=limit + 1))
        else:
            raise CompressionError(f'compression {kind!r} is unknown')
    except ImportError:
        raise CompressionError('it is compressed by lz4, and lz4 is not installed') from None
    except (zstandard.ZstdError, RuntimeError) as error:
        raise CompressionError(str(error)) from None
    _check(len(out), limit)
    return out


def decompress_file(source: Path, target: Path) -> None:
    """
    Decompress a zstd file.

    :raises BagError: if it is damaged, truncated or too large.
    """
    import zstandard
    limit = max(_MAX_FILE, _MAX_RATIO * source.stat().st_size)
    size, ended = 0, True
    try:
        with source.open('rb') as stream, target.open('wb') as out:
            frame = zstandard.ZstdDecompressor().decompressobj()
            while block := stream.read(_BLOCK):
                while block:
                    if frame.eof:
                        frame = zstandard.ZstdDecompressor().decompressobj()
                    size += out.write(frame.decompress(block))
                    _check(size, limit)
                    block = frame.unused_data if frame.eof else b''
                ended = frame.eof
    except (zstandard.ZstdError, CompressionError) as error:
        raise BagError(f'{source} cannot be decompressed: {error}') from None
    except OSError as error:
        raise BagError(f'{source} cannot be decompressed: {error.strerror}') from None
    if not ended:
        raise BagError(f'{source} is truncated: its compressed data end after {size} bytes of the '
                       f'recording; copy the file again from the recorder')


def _check(size: int, limit: int) -> None:
    if size > limit:
        raise CompressionError(f'it expands to more than {limit} bytes')
