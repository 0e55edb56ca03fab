"""Links, files and dependencies that the pages name exist; style by ament's linters, and types."""

import ast
from pathlib import Path
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
FOLDERS = 'bags|bench|config|examples|requirements|test|tools'


def anchors(page):
    """Return the anchors of the headings of a page."""
    headings = re.findall(r'^#+ (.*)$', page.read_text(), re.MULTILINE)
    return {re.sub(r'[^\w -]', '', heading.lower()).replace(' ', '-') for heading in headings}


def each(pages):
    return pytest.mark.parametrize('page', pages, ids=lambda page: page.name)


@each(PAGES)
def test_links_resolve(page):
    for link in re.findall(r'\]\(([^):]+)\)', page.read_text()):
        name, _, anchor = link.partition('#')
        target = page.parent / name if name else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@each(PAGES)
def test_files_and_benches_exist(page):
    text = page.read_text()
    paths = re.findall(rf'(?<![\w/])((?:{FOLDERS})/[\w./-]*\w)', text)
    paths += [module.replace('.', '/') for module in re.findall(r'-m (bench[\w.]*\w)', text)]
    assert [path for path in paths if not any(
        (ROOT / (path + ending)).exists() for ending in ('', '.py'))] == []


PAGE = ROOT / 'docs' / 'dependencies.md'
SOURCES = [path for folder in ('gravity_comp_ros', 'test', 'launch', 'examples', 'bench', 'docs')
           for path in sorted((ROOT / folder).rglob('*.py'))]
# Names of imports and of the package index with another name on the page.
PAGE_NAMES = {'yaml': 'pyyaml', 'sklearn': 'scikit-learn', 'PIL': 'pillow', 'pin': 'pinocchio',
              'xdist': 'pytest-xdist'}


def listed():
    """Return the names in the first column of every table of the page, lower case."""
    names = []
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.split('|')]
        if len(cells) > 3 and cells[1] not in ('dependency', '---') and set(cells[1]) != {'-'}:
            names += [re.sub(r' *([<>≥(].*|, and Debian.*)$', '', part).strip().lower()
                      for part in re.split(r',(?! and)', cells[1])]
    return names


def imported():
    """Return the third-party modules that the source imports, by their names on the page."""
    own = {path.stem for path in SOURCES} | {path.parent.name for path in SOURCES}
    names = set()
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module)
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == 'pytest.importorskip':
                names |= {a.value for a in node.args if isinstance(a, ast.Constant)}
    tops = {name.split('.')[0] for name in names} - set(sys.stdlib_module_names) - own
    return {PAGE_NAMES.get(name, name) for name in tops - {'resource'}}


def required():
    """Return the requirements of setup.py and requirements/, and those that have a reason."""
    names, explained = set(), set()
    lines = re.findall(r"'([A-Za-z][\w-]*(?:>=|<)[\d.]+)'", (ROOT / 'setup.py').read_text())
    for path in (ROOT / 'requirements').glob('*.txt'):
        lines += path.read_text().splitlines()
    for line in lines:
        match = re.match(r'([A-Za-z][\w-]*)(?:==|>=|<)[\d.]+(.*)', line)
        if match and not line.startswith('ros-jazzy'):
            name = PAGE_NAMES.get(match[1], match[1]).lower()
            names.add(name)
            explained |= {name} if re.match(r'  # \w', match[2]) else set()
    return names, explained


def test_each_dependency_is_listed_once():
    names = [*listed(), *required()[1]]
    assert len(names) > 40 and sorted(names) == sorted(set(names))


def test_every_import_is_listed():
    assert {name.lower() for name in imported()} - {*listed(), *required()[1]} == set()


def test_every_requirement_is_listed():
    names, explained = required()
    assert names - explained - set(listed()) == set()


def test_rosdep_keys_are_listed():
    keys = {element.text for element in ElementTree.parse(ROOT / 'package.xml').getroot()
            if element.tag.endswith('depend')}
    names = {*listed(), *required()[1]}
    names |= {name.replace('-', '_') for name in names}
    bare = {re.sub('^python3-|-pip$', '', key) for key in keys} - {'mcap-ros2-support'}
    assert {'pyyaml' if key == 'yaml' else key for key in bare} - names == set()


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
