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


@pytest.mark.parametrize(('pythons', 'environment', 'message'), [
    ({}, {}, 'no Python 3.11 or 3.12 found (no python3 on PATH'),
    ({'python3': ('3.10', ())}, {}, '(python3 is 3.10, which is not enough)'),
    ({'python3': ('3.13', ())}, {}, '(python3 is 3.13, which is not enough)'),
    ({'python3': ('3.11', ('rclpy',))}, {}, 'sudo apt install python3.11-venv'),
    ({'python3': ('3.12', ()), 'other': ('3.9', ())}, {'PYTHON': 'other'},
     'PYTHON=other is Python 3.9; Python 3.11 or 3.12 is needed'),
    ({}, {'PYTHON': 'other'}, 'PYTHON=other: no such program'),
    ({'python3': ('3.12', ('venv',))}, {'ROS_DISTRO': 'humble'},
     'ROS 2 humble is sourced and this package is for Jazzy')])
def test_an_incomplete_machine_is_reported(machine, pythons, environment, message):
    assert message in machine(pythons, **environment)


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
