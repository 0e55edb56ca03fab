"""Opening of recordings: MCAP files, .db3 files, rosbag2 folders, also compressed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import hashlib
from itertools import chain
from pathlib import Path, PurePosixPath
import re
import shlex
import tempfile

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.printable import counted
from gravity_comp_ros.recordings.mcap_storage import MAGIC, McapStorage
from gravity_comp_ros.recordings.messages import (
    Batch, batched, CompressionError, decompress_file, decompressed, MAX_MESSAGE, Storage,
    ZSTD_MAGIC)
from gravity_comp_ros.recordings.sqlite_storage import SqliteStorage

_SQLITE_MAGIC = b'SQLite format 3\0'
_ROS1_MAGIC = b'#ROSBAG V'
_TABLES = ('.csv', '.txt', '.tsv', '.parquet')
# Number and endings of a file of a split recording.
_PART = re.compile(r'(_\d+)?\.(mcap|db3)(\.zstd)?$')


class _Recording(Storage):
    """
    The files of a recording, in order, whose messages may be compressed one by one.

    Compressed messages begin with the magic number of zstd, which no plain message does, so that
    the metadata of the recording is not needed. A damaged message among others is empty.
    """

    def __init__(self, parts: list[Storage], path: Path) -> None:
        self._parts, self._path = parts, path
        self.topics = Counter()
        for part in parts:
            self.topics.update(part.topics)
        self._read, self._damaged = 0, 0

    def batches(self, topic: str) -> Iterator[Batch]:
        for batch in chain.from_iterable(part.batches(topic) for part in self._parts):
            if len(batch) and (self._read or batch.message(0).startswith(ZSTD_MAGIC)):
                yield from batched((int(stamp), self._plain(topic, batch.message(m)))
                                   for m, stamp in enumerate(batch.log_ns))
            else:
                yield batch
        self.notes = [*chain.from_iterable(part.notes for part in self._parts)]
        if self._damaged:
            self.notes.append(f'{counted(self._damaged, "message")} cannot be decompressed')

    def _plain(self, topic: str, data: bytes) -> bytes:
        if not data.startswith(ZSTD_MAGIC):
            return data
        try:
            plain = decompressed(data, 'zstd', MAX_MESSAGE)
            self._read += 1
            return plain
        except CompressionError as error:
            if self._read:
                self._damaged += 1
                return b''
            raise BagError(f'{self._path}: a message on {topic} cannot be decompressed: '
                           f'{error}') from None


@contextmanager
def open_storage(path: Path) -> Iterator[Storage]:
    """
    Open a recording; on exit, close it and remove temporary files.

    :raises BagError: if it does not exist or is not a ROS 2 recording.
    """
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(
            tempfile.TemporaryDirectory(prefix='gravity_comp_')))
        parts = []
        for number, file in enumerate(data_files(path)):
            parts.append(_open_file(file, scratch / str(number)))
            stack.callback(parts[-1].close)
        yield _Recording(parts, path)


def data_files(path: Path) -> list[Path]:
    """
    Return the data files of a recording: the file itself, or the files of a rosbag2 folder.

    :raises BagError: if there are none, or a file named in the metadata is missing.
    """
    try:
        if not path.is_dir():
            return [path]
        names = _named_files(path)
        present = sorted((p for p in path.iterdir() if _PART.search(p.name)), key=_natural)
    except OSError as error:
        raise BagError(f'cannot read {path}: {error.strerror}') from None
    if not names:
        if not present:
            raise BagError(f'{path} is not a recording: it has no .mcap or .db3 file')
        if len({_PART.sub('', file.name) for file in present}) > 1:
            raise BagError(f'{path} has no usable metadata.yaml, but the files of several '
                           f'recordings: name one of {", ".join(file.name for file in present)}')
        return present
    files = [path / name for name in names]
    missing = [file.name for file in files if not file.exists()]
    if missing:
        instead = (f'; there is {", ".join(p.name for p in present)}: name that file instead'
                   if present else '')
        raise BagError(f'metadata.yaml of {path} names {", ".join(missing)}, which does not '
                       f'exist{instead}')
    return files


def fingerprint(path: Path) -> str:
    """Return the SHA-256 of the concatenated data files of a recording."""
    digest = hashlib.sha256()
    for file in data_files(path):
        with file.open('rb') as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def _open_file(file: Path, scratch: Path, source: Path | None = None) -> Storage:
    """Open a file; `source` is the file that it was decompressed from."""
    named = source or file
    try:
        with file.open('rb') as stream:
            magic = stream.read(16)
    except FileNotFoundError:
        raise BagError(f'no such recording: {named}') from None
    except OSError as error:
        raise BagError(f'cannot read {named}: {error.strerror}') from None
    if magic.startswith(MAGIC):
        return McapStorage(file, named)
    if magic.startswith(_SQLITE_MAGIC):
        return SqliteStorage(file, named)
    if magic.startswith(ZSTD_MAGIC) and source is None:
        decompress_file(file, scratch)
        return _open_file(scratch, scratch, file)
    if not magic:
        raise BagError(f'{named} is empty (0 bytes)')
    if magic.startswith(_ROS1_MAGIC):
        raise BagError(f'{named} is a ROS 1 bag; convert it to ROS 2 first (`rosbag reindex` if '
                       f'the recorder was killed, then `rosbags-convert`)')
    if file.suffix.lower() in _TABLES:
        raise BagError(f'{file} is a table, not a recording: first `gravity_comp convert '
                       f'{shlex.quote(str(file))} -o {shlex.quote(file.stem)}.mcap`')
    raise BagError(f'{named} is neither an MCAP nor a .db3 file')


def _named_files(folder: Path) -> list[str]:
    """Return the files that metadata.yaml names; none without one, or with a damaged one."""
    import yaml
    file = folder / 'metadata.yaml'
    if not file.exists():
        return []
    try:
        content = yaml.safe_load(file.read_text(encoding='utf-8'))
        names = content['rosbag2_bagfile_information']['relative_file_paths']
        return [PurePosixPath(name).name for name in names]
    except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError, RecursionError):
        return []


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts bag_10 after bag_9."""
    return [(int(part), '') if part.isdigit() else (-1, part)
            for part in re.split(r'(\d+)', path.name)]
