"""Atomic replacement of files: a reader sees the old file or the new one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import secrets

from gravity_comp_ros.errors import GravityCompError


def write_atomically(path: Path, data: bytes, error: type[GravityCompError]) -> None:
    """
    Write `data` to `path` atomically: after a crash it is the old file or the new one.

    :raises error: if the folder is missing, the disk is full, or writing is not permitted;
        the old file is then untouched.
    """
    with replacing(path, error) as temporary:
        with temporary.open('wb') as stream:
            stream.write(data)


@contextmanager
def replacing(path: Path, error: type[GravityCompError]) -> Iterator[Path]:
    """
    Yield the path of a temporary file that replaces `path` when the block ends without error.

    The temporary file lies in the same folder, because a rename is atomic only within a file
    system; it is flushed to disk before the rename, and removed on failure. For a symbolic link
    the target is replaced, as by an ordinary write.

    :raises error: as `write_atomically`.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f'.{target.name}.{secrets.token_hex(4)}')
    try:
        _create(temporary, target)
    except OSError as problem:
        raise error(_sentence(path, problem)) from problem
    try:
        yield temporary
        _flush_to_disk(temporary, os.O_RDWR)
        os.replace(temporary, target)
        # The new file is in place. Some file systems cannot flush a folder, which does not affect
        # atomicity.
        with suppress(OSError):
            _flush_to_disk(target.parent, os.O_RDONLY)
    except OSError as problem:
        raise error(_sentence(path, problem)) from problem
    finally:
        temporary.unlink(missing_ok=True)


def _flush_to_disk(path: Path, mode: int) -> None:
    handle = os.open(path, mode)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _create(temporary: Path, target: Path) -> None:
    """Create the new file with the old one's permissions, or those of the user's umask."""
    mode = target.stat().st_mode & 0o777 if target.exists() else None
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL,
                     0o666 if mode is None else mode)
    try:
        if mode is not None:
            os.fchmod(handle, mode)
    finally:
        os.close(handle)


def _sentence(path: Path, problem: OSError) -> str:
    reason = problem.strerror or type(problem).__name__
    return f'cannot write {path}: {reason.lower()}; nothing was changed'
