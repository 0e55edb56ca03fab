"""Import rules: one direction, ROS in the node only, NumPy and SciPy alone in the core."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = 'gravity_comp_ros'
MODULES = sorted((ROOT / PACKAGE).rglob('*.py'))

# Lowest first. A module may import from its own package and from lower ones.
ROOMS = (
    ('errors', 'printable', 'display', 'atomic'),
    ('data', 'worker'),
    ('facts',),
    ('simulation', 'recordings', 'models'),
    ('effects', 'description'),
    ('calibration', 'description_check', 'evaluation', 'regression'),
    ('estimation',),
    ('diagnosis',),
    ('planning', 'export'),
    ('api',),
    ('__init__',),
    ('report', 'fleet'),
    ('node', 'workbench', 'commands', 'cli'),
)
LEVEL_OF = {name: level for level, names in enumerate(ROOMS) for name in names}
CORE = ({name for names in ROOMS[:8] for name in names}
        - {'recordings', 'simulation', 'description', 'description_check',
           'calibration'})
# Forbidden imports between packages of a level or of adjacent levels.
FORBIDDEN = {
    'node': {'commands', 'cli', 'workbench', 'simulation'},
    'commands': {'node'},
    'workbench': {'commands', 'cli'},
    'cli': {'node', 'workbench'},
    'models': {'recordings', 'simulation'},
    'recordings': {'models', 'simulation'},
    # Ground truth for tests of effects and models, so it must share no code with them.
    'simulation': {'models', 'recordings'},
}
ROS = {'rclpy', 'ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs',
       'lifecycle_msgs', 'rcl_interfaces', 'rosgraph_msgs', 'sensor_msgs', 'std_msgs', 'std_srvs',
       'launch', 'launch_ros'}


def room(path: Path) -> str:
    """Return the top-level module or subpackage of the package that `path` belongs to."""
    return path.relative_to(ROOT / PACKAGE).parts[0].removesuffix('.py')


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def imported(path: Path) -> set[str]:
    """Return the dotted names that a file imports, at module level or inside functions."""
    names: set[str] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: relative import'
            names.add(node.module)
            if node.module == PACKAGE:
                names |= {f'{PACKAGE}.{alias.name}' for alias in node.names}
    return names


def rooms_imported(path: Path) -> set[str]:
    """Return the top-level modules of this package that a file imports from."""
    parts = [name.split('.') for name in imported(path)]
    return {part[1] for part in parts if part[0] == PACKAGE and len(part) > 1} - {'__version__'}


def test_imports_flow_downwards():
    assert {room(path) for path in MODULES} <= set(LEVEL_OF), 'give each room a level in this test'
    wrong = [f'{path} imports {other}' for path in MODULES for other in rooms_imported(path)
             if LEVEL_OF[other] > LEVEL_OF[room(path)]
             or other in FORBIDDEN.get(room(path), set())]
    assert not wrong


def test_no_import_cycle():
    dotted = {'.'.join(path.relative_to(ROOT).with_suffix('').parts): path for path in MODULES}
    after = {name: {other for other in imported(path) if other in dotted and other != name}
             for name, path in dotted.items()}
    TopologicalSorter(after).prepare()  # raises CycleError, which names the modules


def test_only_the_node_imports_ros():
    used = {path: ROS & {name.split('.')[0] for name in imported(path)} for path in MODULES}
    assert {room(path) for path, names in used.items() if names} == {'node'}, used


def test_the_core_needs_numpy_and_scipy_alone():
    allowed = set(sys.stdlib_module_names) | {PACKAGE, 'numpy', 'scipy'}
    others = {path: {name.split('.')[0] for name in imported(path)} - allowed
              for path in MODULES if room(path) in CORE}
    assert not {str(path): names for path, names in others.items() if names}


def test_package_xml_lists_every_ros_package_that_is_imported():
    manifest = (ROOT / 'package.xml').read_text()
    listed = set(re.findall(r'<exec_depend>(.*)</exec_depend>', manifest))
    launch = sorted((ROOT / 'launch').glob('*.py'))
    used = {name.split('.')[0] for path in [*MODULES, *launch] for name in imported(path)}
    assert used & ROS <= listed
    assert listed & ROS <= used, 'listed but not used'


@pytest.mark.parametrize(('modules', 'slow'), [
    # The import of these three takes longer than all others together; few runs need them.
    ('api.loop commands.fit node.jobs workbench.jobs', 'scipy.stats scipy.signal scipy.optimize'),
    # The fits of a node run in another process, and it must restart fast.
    ('node.node_core', 'scipy gravity_comp_ros.estimation.fit gravity_comp_ros.diagnosis')])
def test_programs_start_without_slow_modules(modules, slow):
    program = ('import sys\n' + ''.join(f'import {PACKAGE}.{name}\n' for name in modules.split())
               + f'print(sorted(set({slow.split()!r}) & set(sys.modules)))')
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True,
                          cwd=ROOT, timeout=120)
    assert done.stdout == '[]\n', done.stdout + done.stderr


@pytest.mark.parametrize('path', sorted((ROOT / 'bench').rglob('*.py')),
                         ids=lambda path: path.stem)
def test_benches_import(path):
    try:
        import_module('.'.join(path.relative_to(ROOT).with_suffix('').parts))
    except ModuleNotFoundError as missing:
        assert missing.name.partition('.')[0] not in ('bench', PACKAGE), missing
