"""docs/json.md documents exactly the keys that the verbs print."""

from dataclasses import replace
import json
from pathlib import Path
import re

from bench.shared.rough_links import two_link_urdf, two_links
from gravity_comp_ros.cli import main, VERBS
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import numpy as np
import pytest

PAGE = (Path(__file__).resolve().parents[2] / 'docs' / 'json.md').read_text()
SECTIONS = dict(re.findall(r'^## (\w+)\n(.*?)(?=^## |\Z)', PAGE, re.MULTILINE | re.DOTALL))
CALLS = {
    'fit': ('1.mcap', '--holdout', '-o', 'm.json'), 'compare': ('2.mcap', '--model', 'm.json'),
    'diagnose': ('1.mcap', '--model', 'm.json', '--effects', 'coulomb_friction'),
    'add': ('coulomb_friction:shoulder', '1.mcap', '--model', 'm.json'),
    'update': ('2.mcap', '--model', 'm.json'), 'export': ('m.json', '--to', 'c', '-o', 'code'),
    'info': ('1.mcap',), 'check': ('1.mcap', '--urdf', 'arm.urdf'),
    'calibrate': ('1.mcap', 'loaded.mcap', '--mass', '1', '--com', '0', '0', '-0.4', '--urdf',
                  'arm.urdf'),
    'replay': ('1.mcap', '--model', 'm.json', '-o', 'out.mcap'),
    'plan': ('1.mcap', '--model', 'm.json', '--settle', 'viscous_friction:shoulder', '--duration',
             '20', '-o', 'motion.yaml'),
    'synth': ('--motion', 'eq15', '-o', 'synth.mcap'), 'convert': ('table.csv', '-o', 'c.mcap'),
    'fleet': ('fit', 'robots', '-o', 'models', '--workers', '1')}


def keys(table: str) -> set[str]:
    """Return the names in the first column of a table."""
    rows = [row for row in table.splitlines() if row.startswith('| `')]
    return {name for row in rows for name in re.findall(r'`(\w+)`', row.split('|')[1])}


@pytest.fixture(scope='module')
def printed(tmp_path_factory):
    pytest.importorskip('distributed')
    folder = tmp_path_factory.mktemp('json')
    (folder / 'robots' / 'one').mkdir(parents=True)
    for name, seed in (('1', 1), ('2', 2), ('robots/one/1', 1)):
        write_bag(folder / f'{name}.mcap', [joint_states(two_links(seed))])
    (folder / 'arm.urdf').write_text(two_link_urdf(masses=(1.53, 1.02)))
    # 1 kg at the end of the second link, of 0.4 m.
    load = two_links(3)
    both = 9.80665 * 0.4 * np.sin(load.q.sum(axis=1))
    write_bag(folder / 'loaded.mcap', [joint_states(replace(load, tau=load.tau + np.column_stack(
        [both + 9.80665 * 0.4 * np.sin(load.q[:, 0]), both])))])
    (folder / 'table.csv').write_text('t,q_1,tau_1\n' + ''.join(
        f'{k / 10},{k / 100},{k}\n' for k in range(30)))
    output = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for verb, arguments in CALLS.items():
            assert main([verb, *arguments, '--json', f'{verb}.json']) == 0, verb
            output[verb] = json.loads(Path(f'{verb}.json').read_text())
    return output


@pytest.mark.parametrize('verb', CALLS)
def test_keys_of_each_verb_are_documented(verb, printed):
    assert next(iter(printed[verb].items())) == ('schema', 1)
    assert keys(SECTIONS[verb]) == set(printed[verb]) - {'schema'}


def test_nested_keys_are_documented(printed):
    whole = keys(PAGE) | set(re.findall(r'`(\w+)`', PAGE))
    for inner in (printed['fit']['joints']['shoulder'], printed['fit']['bags'][0],
                  printed['compare']['joints']['shoulder'], printed['fit']['gate'],
                  printed['diagnose']['joints']['shoulder'], printed['diagnose']['findings'][0],
                  printed['add']['effects'][0], printed['add']['held_out']['elbow'],
                  printed['fit']['holdout'], printed['info']['recordings'][0]):
        assert set(inner) <= whole, set(inner) - whole


def test_all_verbs_are_documented():
    # `workbench` and `completion` print no JSON.
    assert set(SECTIONS) == set(VERBS) - {'workbench', 'completion'}
