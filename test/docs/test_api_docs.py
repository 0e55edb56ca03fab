"""API documentation: the generated pages, the example of the package, the notebook."""

import inspect
from pathlib import Path
import runpy
import textwrap

from bench.shared.rough_links import two_links
import gravity_comp_ros as gc
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def pages(tmp_path_factory):
    pytest.importorskip('pdoc')
    from docs import make_api
    folder = tmp_path_factory.mktemp('api')
    make_api.make(folder)
    return ''.join(path.read_text() for path in folder.rglob('*.html'))


def test_every_public_name_is_on_the_pages(pages):
    for name in gc.__all__:
        assert f'>{name}</' in pages, name
    # An unparsed field list would be copied literally.
    assert ':param' not in pages and ':raises' not in pages and '**' not in pages


@pytest.mark.parametrize('name', gc.__all__)
def test_public_names_are_documented(name):
    thing = getattr(gc, name)
    assert inspect.getdoc(thing)
    if inspect.isfunction(thing):
        assert ':raises' in thing.__doc__
        assert all(parameter.annotation is not inspect.Parameter.empty
                   for parameter in inspect.signature(thing).parameters.values())
    elif not issubclass(thing, Exception):
        own = [item for key, item in vars(thing).items() if not key.startswith('_')]
        assert all(inspect.getdoc(item) for item in own
                   if inspect.isfunction(item) or isinstance(item, property)), name


def test_the_example_of_the_package_runs(tmp_path, monkeypatch, capsys):
    for name, seed in (('run1', 1), ('run2', 2), ('tool', 3)):
        write_bag(tmp_path / f'{name}.mcap', [joint_states(two_links(seed))])
    monkeypatch.chdir(tmp_path)
    code = textwrap.dedent('\n'.join(line for line in gc.__doc__.splitlines()
                                     if line.startswith('    ')))
    assert len(code.splitlines()) == 10
    exec(compile(code, 'example', 'exec'), {})
    assert capsys.readouterr().out.count('error of the model on') == 2
    assert gc.load('arm.json').effects


def test_the_notebook_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    ran = runpy.run_path(str(ROOT / 'examples' / 'notebook.py'))
    printed = capsys.readouterr().out
    assert [(f.effect, f.joint) for f in ran['diagnosis'].found] == [
        ('coulomb_friction', 'shoulder')]
    size = ran['diagnosis'].found[0].coefficients['F_c']
    assert size.ci95[0] < ran['FRICTION'] < size.ci95[1]
    before, after = ran['before'].joints['shoulder'], ran['after'].joints['shoulder']
    assert after.rmse < 1.15 * ran['NOISE'] < 0.2 * before.rmse
    assert gc.compare(ran['model'], ran['tool']).joints['shoulder'].rmse < 2 * ran['NOISE'] \
        < ran['stale'].joints['shoulder'].rmse
    assert 'Missing: Coulomb friction on joint shoulder' in printed
    assert gc.load('arm.json').effects == ('coulomb_friction:shoulder',)
