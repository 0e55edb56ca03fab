"""Style by ament's linters (flake8, and docstrings by PEP 257), and types."""

from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
# The files that a workspace installs; ruff checks tests and benches, too.
INSTALLED = [name for name in ('gravity_comp_ros', 'launch', 'setup.py') if (ROOT / name).exists()]


def lint(*command, paths):
    """Return exit status and output of a linter with the settings in setup.cfg."""
    done = subprocess.run([sys.executable, '-m', *command, *map(str, paths)], cwd=ROOT,
                          capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout + done.stderr


def test_flake8():
    status, output = lint('flake8', '--config', 'setup.cfg', paths=INSTALLED)
    assert status == 0, output


def test_ruff():
    # Includes docstrings by the rules of ament_pep257.
    status, output = lint('ruff', 'check', '--no-cache', paths=())
    assert status == 0, output


def test_types():
    status, output = lint('mypy', paths=())
    assert status == 0, output


@pytest.mark.parametrize('linter, text, code', [
    (('flake8', '--config', 'setup.cfg'), 'import sys\nimport os\nprint(os, sys)\n', 'I100'),
    (('flake8', '--config', 'setup.cfg'), 'x = "double"\n', 'Q000'),
    (('flake8', '--config', 'setup.cfg'), f'x = {"1" * 99}\n', 'E501'),
    (('ruff', 'check', '--config', 'pyproject.toml'),
     'def f():\n    """Returns\n    x"""\n', 'D205'),
    (('mypy', '--config-file', 'pyproject.toml'), 'def f(x):\n    return x\n', 'no-untyped-def'),
    (('mypy', '--config-file', 'pyproject.toml'), 'x: int = "text"\n', 'assignment'),
])
def test_linters_detect_a_violation(tmp_path, linter, text, code):
    file = tmp_path / 'bad.py'
    file.write_text(text)
    status, output = lint(*linter, paths=[file])
    assert status != 0 and code in output
