"""A test that crashes or hangs fails alone: the run continues and ends."""

import os
from pathlib import Path
import subprocess
import sys

from conftest import LONGEST

ROOT = Path(__file__).resolve().parents[1]
FINE = 'def test_fine(): pass\ndef test_too(): pass\n'
FATAL = {
    'crash': 'import os, signal\n\n\ndef test_it(): os.kill(os.getpid(), signal.SIGSEGV)\n',
    'hang': 'import time\n\n\ndef test_it(): time.sleep(300)\n'}


def test_a_crash_and_a_hang_fail_one_test_each(tmp_path):
    # xdist's own scheduler waits for ever if the last test of a file crashes.
    (tmp_path / 'test_crash.py').write_text(FINE + FATAL['crash'])
    (tmp_path / 'test_hang.py').write_text(FATAL['hang'] + FINE)
    (tmp_path / 'test_fine.py').write_text(FINE)
    for name in ('conftest.py', 'file_scheduling.py'):
        (tmp_path / name).write_text((ROOT / 'test' / name).read_text())
    (tmp_path / 'pytest.ini').write_text('[pytest]\nmarkers = slow\npythonpath = .\n')
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-p', 'xdist', '-p', 'pytest_timeout', '-n', '2',
         '--max-worker-restart', '3', '-p', 'no:cacheprovider', '--timeout', '2',
         '--timeout-method', 'thread'], cwd=tmp_path, capture_output=True, text=True,
        timeout=200, env={**os.environ, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1'})
    assert done.returncode == 1, done.stdout + done.stderr
    assert '2 failed, 6 passed' in done.stdout, done.stdout
    for name in FATAL:
        assert f"crashed while running 'test_{name}.py::test_it'" in done.stdout


def test_the_longest_files_exist():
    assert [name for name in LONGEST if not (ROOT / 'test' / name).is_file()] == []
