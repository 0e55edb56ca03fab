"""Build and installation of the package in a ROS workspace."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
NAME = 'gravity_comp_ros'
IGNORED = shutil.ignore_patterns('.*', '__pycache__', 'build', 'install', 'log', '*.egg-info',
                                 'demo-output', 'test-artifacts')


def colcon(workspace, *arguments):
    program = shutil.which('colcon', path=str(Path(sys.executable).parent)) or 'colcon'
    environment = {**os.environ, 'PYTHONPATH': '', 'COLCON_HOME': str(workspace / 'home'),
                   'PATH': f'{Path(sys.executable).parent}:{os.environ["PATH"]}'}
    return subprocess.run([program, '--log-base', str(workspace / 'log'), *arguments],
                          cwd=workspace, env=environment, capture_output=True, text=True,
                          timeout=300)


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    folder = tmp_path_factory.mktemp('workspace')
    shutil.copytree(ROOT, folder / 'src' / NAME, ignore=IGNORED)
    built = colcon(folder, 'build', '--event-handlers', 'console_direct+')
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def run_installed(workspace, executable, *arguments):
    """Run an installed executable with the environment of a sourced workspace."""
    prefix = workspace / 'install' / NAME
    site = next(prefix.glob('lib/python3*/site-packages'))
    path = os.pathsep.join(filter(None, [str(site), os.environ.get('PYTHONPATH', '')]))
    environment = {**os.environ, 'PYTHONPATH': path,
                   'AMENT_PREFIX_PATH': os.pathsep.join(filter(
                       None, [str(prefix), os.environ.get('AMENT_PREFIX_PATH', '')]))}
    return subprocess.run([str(prefix / 'lib' / NAME / executable), *arguments], cwd=workspace,
                          env=environment, capture_output=True, text=True, timeout=60)


def test_colcon_lists_an_ament_python_package(workspace):
    listed = colcon(workspace, 'list')
    assert listed.stdout.split() == [NAME, f'src/{NAME}', '(ros.ament_python)'], listed.stderr


def test_executables_are_installed_for_ros2_run(workspace):
    folder = workspace / 'install' / NAME / 'lib' / NAME
    assert {path.name for path in folder.iterdir()} == {'gravity_comp', 'gravity_comp_node'}
    assert all(os.access(path, os.X_OK) for path in folder.iterdir())


def test_installed_command_runs_from_the_installed_package(workspace):
    done = run_installed(workspace, 'gravity_comp', '--help')
    assert done.returncode == 0, done.stderr
    assert 'the loop:' in done.stdout and 'not available' not in done.stdout


def test_installed_node_runs(workspace):
    # An invalid parameter ends the node with a message, after all its modules are imported.
    done = run_installed(workspace, 'gravity_comp_node', '--ros-args', '-p', 'max_speed:=-1.0')
    assert done.returncode == 1
    line = done.stderr.splitlines()[-1]
    assert line.startswith('gravity_comp_node: ') and 'max_speed' in line


@pytest.mark.parametrize('folder', ['config', 'launch', 'bags'])
def test_share_contains_every_file_of(workspace, folder):
    shared = workspace / 'install' / NAME / 'share' / NAME / folder
    expected = {path.relative_to(ROOT / folder) for path in (ROOT / folder).rglob('*')
                if path.is_file() and '__pycache__' not in path.parts
                and not path.name.startswith('.')}
    installed = {path.relative_to(shared) for path in shared.rglob('*') if path.is_file()}
    assert expected and installed == expected


def test_ament_index_lists_the_package(workspace):
    share = workspace / 'install' / NAME / 'share'
    assert (share / 'ament_index/resource_index/packages' / NAME).is_file()
    assert (share / NAME / 'package.xml').read_text() == (ROOT / 'package.xml').read_text()
