"""Atomic replacement of files, without remaining temporary files."""

import errno
import os
from pathlib import Path
import signal
import subprocess
import sys
import textwrap

from gravity_comp_ros.atomic import replacing, write_atomically
from gravity_comp_ros.errors import BagError, ModelFileError
import pytest

ROOT = Path(__file__).resolve().parents[2]


def failing(number: int):
    """Return a function that raises an operating-system error."""
    def fail(*args, **kwargs):
        raise OSError(number, os.strerror(number))
    return fail


@pytest.fixture
def old(tmp_path) -> Path:
    path = tmp_path / 'file.json'
    path.write_bytes(b'old')
    return path


def test_a_new_file(tmp_path):
    write_atomically(tmp_path / 'new', b'data', ModelFileError)
    assert (tmp_path / 'new').read_bytes() == b'data'
    assert os.listdir(tmp_path) == ['new']


def test_the_old_file_remains_until_the_block_ends(old):
    with replacing(old, ModelFileError) as temporary:
        temporary.write_bytes(b'ne')
        assert old.read_bytes() == b'old'
        assert temporary.parent == old.parent and temporary.name.startswith('.')
    assert old.read_bytes() == b'ne'


@pytest.mark.parametrize('problem', [ValueError('mine'), KeyboardInterrupt()])
def test_an_exception_in_the_block_passes_and_changes_nothing(old, problem):
    with pytest.raises(type(problem)):
        with replacing(old, ModelFileError) as temporary:
            temporary.write_bytes(b'half')
            raise problem
    assert old.read_bytes() == b'old' and os.listdir(old.parent) == ['file.json']


@pytest.mark.parametrize('function, number, message', [
    ('fsync', errno.ENOSPC, 'no space left on device'),
    ('fsync', errno.EIO, 'input/output error'),
    ('replace', errno.EACCES, 'permission denied'),
    ('replace', errno.EROFS, 'read-only file system'),
])
def test_a_failing_disk_leaves_the_old_file(old, monkeypatch, function, number, message):
    monkeypatch.setattr(os, function, failing(number))
    with pytest.raises(BagError, match=message) as caught:
        write_atomically(old, b'new', BagError)
    assert str(old) in str(caught.value) and '\n' not in str(caught.value)
    assert 'nothing was changed' in str(caught.value)
    assert old.read_bytes() == b'old' and os.listdir(old.parent) == ['file.json']


def test_a_folder_that_cannot_be_flushed_is_not_an_error(old, monkeypatch):
    flush, calls = os.fsync, []

    def flush_only_the_file(handle):
        calls.append(handle)
        if len(calls) > 1:
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        flush(handle)

    monkeypatch.setattr(os, 'fsync', flush_only_the_file)
    write_atomically(old, b'new', ModelFileError)
    assert old.read_bytes() == b'new' and len(calls) == 2


def test_a_full_disk_while_writing(old):
    resource = pytest.importorskip('resource')
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        with pytest.raises(ModelFileError, match='file too large'):
            write_atomically(old, b'x' * 100000, ModelFileError)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, before)
    assert old.read_bytes() == b'old' and os.listdir(old.parent) == ['file.json']


@pytest.mark.parametrize('place, message', [
    ('missing/file.json', 'no such file or directory'),
    ('file.json/below', 'not a directory'),
])
def test_a_folder_that_cannot_be_written_to(old, place, message):
    path = old.parent / place
    with pytest.raises(ModelFileError, match=message) as caught:
        write_atomically(path, b'new', ModelFileError)
    assert str(path) in str(caught.value)
    assert old.read_bytes() == b'old' and os.listdir(old.parent) == ['file.json']


def test_a_folder_at_the_path_of_the_file(tmp_path):
    (tmp_path / 'folder').mkdir()
    with pytest.raises(ModelFileError, match='directory'):
        write_atomically(tmp_path / 'folder', b'new', ModelFileError)
    assert os.listdir(tmp_path) == ['folder']


@pytest.mark.parametrize('mode', [0o600, 0o640, 0o666])
def test_the_old_files_mode_is_kept(old, mode):
    old.chmod(mode)
    write_atomically(old, b'new', ModelFileError)
    assert old.stat().st_mode & 0o777 == mode


def test_a_new_file_follows_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / 'new', b'', ModelFileError)
    finally:
        assert os.umask(before) == 0o027
    assert (tmp_path / 'new').stat().st_mode & 0o777 == 0o640


def test_a_link_stays_a_link_and_its_target_changes(old):
    link = old.parent / 'link.json'
    link.symlink_to(old)
    write_atomically(link, b'new', ModelFileError)
    assert link.is_symlink()
    assert old.read_bytes() == b'new'


@pytest.mark.parametrize('moment', ['in the block', 'before the rename'])
def test_a_killed_process_leaves_the_old_file(old, moment):
    script = textwrap.dedent(f"""
        import os, signal, sys
        from pathlib import Path
        from gravity_comp_ros import atomic
        from gravity_comp_ros.errors import ModelFileError

        def die(*args):
            os.kill(os.getpid(), signal.SIGKILL)

        if {moment!r} == 'before the rename':
            os.replace = die
        with atomic.replacing(Path(sys.argv[1]), ModelFileError) as temporary:
            temporary.write_bytes(b'half')
            if {moment!r} == 'in the block':
                die()
        """)
    done = subprocess.run([sys.executable, '-c', script, str(old)], cwd=ROOT, timeout=60)
    assert done.returncode == -signal.SIGKILL
    assert old.read_bytes() == b'old'
