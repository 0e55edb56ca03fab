"""Style by ament's linters (flake8, and docstrings by PEP 257), and types."""

from pathlib import Path
import subprocess
import sys


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
