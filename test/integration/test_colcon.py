"""Build and installation of the package in a ROS workspace."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

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


def files(folder):
    return {path.relative_to(folder) for path in folder.rglob('*') if path.is_file()
            and '__pycache__' not in path.parts and not path.name.startswith('.')}


def test_the_package_is_built_and_its_executables_run(tmp_path):
    shutil.copytree(ROOT, tmp_path / 'src' / NAME, ignore=IGNORED)
    listed = colcon(tmp_path, 'list')
    assert listed.stdout.split() == [NAME, f'src/{NAME}', '(ros.ament_python)'], listed.stderr
    built = colcon(tmp_path, 'build', '--event-handlers', 'console_direct+')
    assert built.returncode == 0, built.stdout + built.stderr
    prefix = tmp_path / 'install' / NAME
    assert {path.name for path in (prefix / 'lib' / NAME).iterdir()} == {
        'gravity_comp', 'gravity_comp_node'}
    done = run_installed(tmp_path, 'gravity_comp', '--help')
    assert done.returncode == 0, done.stderr
    assert 'the loop:' in done.stdout and 'not available' not in done.stdout
    # An invalid parameter ends the node with a message, after all its modules are imported.
    done = run_installed(tmp_path, 'gravity_comp_node', '--ros-args', '-p', 'max_speed:=-1.0')
    line = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and line.startswith('gravity_comp_node: ') and 'max_speed' in line
    share = prefix / 'share'
    for folder in ('config', 'launch', 'bags'):
        assert files(share / NAME / folder) == files(ROOT / folder) != set()
    assert (share / 'ament_index/resource_index/packages' / NAME).is_file()
    assert (share / NAME / 'package.xml').read_text() == (ROOT / 'package.xml').read_text()
