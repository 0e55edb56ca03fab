"""Launch file and example configurations, checked without the launch package."""

import ast
import json
from pathlib import Path
import subprocess
import sys

ROOT = Path(__file__).resolve().parents[2]
SOURCE = (ROOT / 'launch' / 'gravity_comp.launch.py').read_text()


def calls(name):
    return [node for node in ast.walk(ast.parse(SOURCE)) if isinstance(node, ast.Call)
            and getattr(node.func, 'id', '') == name]


def keywords(call):
    return {k.arg: k.value for k in call.keywords}


def test_it_starts_the_installed_executable_with_declared_arguments():
    compile(SOURCE, 'gravity_comp.launch.py', 'exec')
    node = keywords(*calls('Node'))
    assert node['package'].value == 'gravity_comp_ros'
    assert node['name'].value == 'gravity_comp'
    assert f"'{node['executable'].value} = gravity_comp_ros.node.main:main'" in (
        ROOT / 'setup.py').read_text()
    declared = {call.args[0].value for call in calls('DeclareLaunchArgument')}
    used = {call.args[0].value for call in calls('LaunchConfiguration')}
    assert declared == used == {
        'params_file', 'namespace', 'joint_states', 'commands', 'use_sim_time', 'respawn'}
    parts = [item.value for call in calls('PathJoinSubstitution')
             for item in call.args[0].elts[1:]]
    assert (ROOT / Path(*parts)).is_file()


def test_without_ros_it_ends_with_one_line():
    done = subprocess.run(
        [sys.executable, '-c', 'import sys; sys.modules["rclpy"] = None; '
         'from gravity_comp_ros.node.main import main; sys.exit(main([]))'],
        cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and not done.stdout
    assert done.stderr.startswith('gravity_comp_node: ') and 'source /opt/ros/jazzy' in done.stderr
    assert done.stderr.count('\n') == 1


READ = """
import json, sys, rclpy
from rclpy.node import Node
for path, names in json.loads(sys.argv[1]).items():
    rclpy.init(args=['x', '--ros-args', '--params-file', path])
    for name in names:
        node = Node(name, automatically_declare_parameters_from_overrides=True)
        assert len(node.get_parameters_by_prefix('')) > 1, (path, name)
        node.destroy_node()
    rclpy.shutdown()
"""


def test_ros_reads_the_examples():
    import yaml
    # The parser of ROS accepts no aliases and no lists of mixed types.
    nodes = {str(path): [name.replace('/**', 'any') for name in yaml.safe_load(path.read_text())]
             for path in sorted((ROOT / 'config').glob('*.yaml'))}
    done = subprocess.run([sys.executable, '-c', READ, json.dumps(nodes)], cwd=ROOT,
                          capture_output=True, text=True, timeout=120)
    assert len(nodes) > 5 and done.returncode == 0, done.stderr
