"""Setup on an incomplete machine: an error of one line, and no virtual environment."""

import os
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ('sh', 'dirname', 'cat', 'cksum', 'tr')


@pytest.fixture
def machine(tmp_path):
    """Return a function that runs the script with a PATH of the given Pythons."""
    programs = tmp_path / 'bin'
    programs.mkdir()
    for name in TOOLS:
        (programs / name).symlink_to(shutil.which(name))

    def run(pythons, **environment):
        for name, (version, modules) in pythons.items():
            # A substitute for Python that answers the queries for version and modules.
            lines = ['#!/bin/sh', 'case "$2" in', f'*version_info*) echo {version} ;;']
            lines += [f'*import*{module}*) exit 0 ;;' for module in modules]
            (programs / name).write_text('\n'.join([*lines, '*) exit 1 ;;', 'esac', '']))
            (programs / name).chmod(0o755)
        folder = tmp_path / 'venv'
        done = subprocess.run(
            [str(programs / 'sh'), str(ROOT / 'tools/make_venv.sh'), str(folder), 'newest'],
            env={'PATH': str(programs), **environment}, capture_output=True, text=True,
            timeout=30)
        assert done.returncode == 1 and not done.stdout and not folder.exists()
        assert done.stderr.count('\n') == 1, done.stderr
        return done.stderr
    return run


def test_no_python(machine):
    assert 'no Python 3.11 or 3.12 found (no python3 on PATH' in machine({})


@pytest.mark.parametrize('version', ['3.10', '3.13'])
def test_wrong_python(machine, version):
    assert f'(python3 is {version}, which is not enough)' in machine({'python3': (version, ())})


def test_python_without_venv(machine):
    assert 'sudo apt install python3.11-venv' in machine({'python3': ('3.11', ('rclpy',))})


def test_named_python_is_wrong(machine):
    line = machine({'python3': ('3.12', ()), 'other': ('3.9', ())}, PYTHON='other')
    assert 'PYTHON=other is Python 3.9; Python 3.11 or 3.12 is needed' in line


def test_named_python_is_missing(machine):
    assert 'PYTHON=other: no such program' in machine({}, PYTHON='other')


def test_another_ros_is_sourced(machine):
    line = machine({'python3': ('3.12', ('venv',))}, ROS_DISTRO='humble')
    assert 'ROS 2 humble is sourced and this package is for Jazzy' in line


@pytest.mark.parametrize('ros', ['jazzy', 'kilted', 'rolling'])
def test_a_sourced_ros_is_used_with_its_own_python(machine, ros):
    line = machine({'python3': ('3.12', ('venv',))}, ROS_DISTRO=ros)
    assert 'cannot import rclpy' in line and f'/opt/ros/{ros}/setup.sh' in line
    # The script reaches the check of the venv module, with the Python that has rclpy.
    line = machine({'python3': ('3.12', ('rclpy',))}, ROS_DISTRO=ros)
    assert 'sudo apt install python3.12-venv' in line


WITHOUT = """
import sys, pytest
from importlib.abc import MetaPathFinder

class Missing(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.split('.')[0] in {names!r}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)

sys.meta_path.insert(0, Missing())
sys.exit(pytest.main(['-q', '--collect-only', '-p', 'no:xdist', *sys.argv[1:]]))
"""


def test_files_whose_modules_are_not_installed_are_skipped():
    """As by `colcon test` in a workspace with the packages of rosdep alone."""
    files = ('test/unit/workbench/test_workbench_access.py', 'test/integration/test_fleet.py')
    program = WITHOUT.format(names=['bokeh', 'distributed'])
    done = subprocess.run([sys.executable, '-c', program, *files], cwd=ROOT, capture_output=True,
                          text=True, timeout=120)
    assert 'integration/test_fleet.py: distributed is not installed' in done.stdout
    assert 'error' not in done.stdout and done.stdout.count('SKIPPED') == 2


def test_versions_agree():
    from gravity_comp_ros import __version__
    assert f'<version>{__version__}</version>' in (ROOT / 'package.xml').read_text()
    assert f"version='{__version__}'" in (ROOT / 'setup.py').read_text()


def test_commands_of_the_readme_exist():
    readme = (ROOT / 'README.md').read_text()
    targets = set(re.findall(r'^([a-z-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE))
    named = set(re.findall(r'^(?:\$ )?make ([a-z-]+)', readme, re.MULTILINE))
    assert {'demo', 'test'} <= named <= targets
    from gravity_comp_ros.cli import VERBS
    verbs = set(re.findall(r'gravity_comp ([a-z]+)', readme))
    assert verbs and verbs <= {*VERBS, 'payload'}


@pytest.mark.parametrize('script', ['tools/make_venv.sh', '.ci/run'])
def test_scripts_are_executable(script):
    assert os.access(ROOT / script, os.X_OK)
