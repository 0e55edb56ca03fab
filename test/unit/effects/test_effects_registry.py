"""Effects of other packages: loading, skipping of broken ones, and isolation of errors."""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys

from bench.shared.effect_motions import clean_motion
from docs import make_effects
from gravity_comp_ros.effects.offset import TorqueOffset
from gravity_comp_ros.effects.periodic import TorqueRipple
from gravity_comp_ros.effects.registry import all_effects, guarded, known_effect, library_effects
from gravity_comp_ros.errors import OptionError
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[3]
ASK = ('import json\n'
       'from gravity_comp_ros.effects.registry import all_effects, broken_plug_ins\n'
       'print(json.dumps([list(all_effects()), broken_plug_ins()]))\n')
EFFECT = """
from gravity_comp_ros.effects.effect import Coefficient, Effect


class Plain(Effect):
    title, family, equation, description = 'T', 'f', 'e', 'd'
    coefficients = (Coefficient('c', 'N·m', 'm'),)
    confounders, experiment, signature, source = ('time_delay',), 'x', 'time', 's'

    def __init__(self, name):
        self.name = name
        super().__init__()

    def columns(self, motion, joint, setting):
        return motion.qdd[:, [joint]]


effect = Plain


"""


def ask(*folders, program=ASK):
    """Return effects and skipped plug-ins of a Python with the packages of these folders."""
    path = os.pathsep.join([*map(str, folders), str(ROOT)])
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True,
                          env={**os.environ, 'PYTHONPATH': path}, timeout=60, cwd=folders[0])
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def plug_in(folder, module, source, *points):
    """Write an installed package with these entry points."""
    info = folder / f'{module}-1.dist-info'
    info.mkdir(parents=True)
    (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {module}\nVersion: 1\n')
    (info / 'entry_points.txt').write_text(
        '[gravity_comp_ros.effects]\n' + ''.join(f'{point}\n' for point in points))
    (folder / f'{module}.py').write_text(source)


def test_the_example_package_installs_and_is_found(tmp_path):
    source, target = tmp_path / 'source', tmp_path / 'target'
    shutil.copytree(ROOT / 'examples' / 'custom_effect', source)
    done = subprocess.run(
        [sys.executable, '-m', 'pip', '--disable-pip-version-check', 'install', '-q', '--no-deps',
         '--no-build-isolation', '--no-index', '--target', str(target), str(source)],
        capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    program = ASK + (
        'import sys\nsys.path.insert(0, "' + str(ROOT) + '")\n'
        'from bench.shared.effect_motions import clean_motion\n'
        'effect = all_effects()["seal_drag"]\n'
        'motion = clean_motion("pendulum")\n'
        'assert effect.untestable(motion, 0) is None\n'
        'assert effect.settings(motion, 0)\n'
        'column = effect.columns(motion, 0, effect.settings(motion, 0)[0])\n'
        'assert column.shape == (motion.samples.n_samples, 1) and column.std() > 0\n'
        'assert "energy" in effect.implausible(column[:1, 0] * 0 - 1, {})\n')
    names, skipped = ask(target, program=program)
    assert names[-1] == 'seal_drag' and not skipped
    assert names[:-1] == list(library_effects())


BROKEN = (
    ('raise RuntimeError("no licence\\nfor this robot")\n', 'no licence for this'),
    ('import not_there\n', 'not_there'),
    ('thing = 3\n', 'not an Effect'),
    ('x = 1\n', 'thing'),
    ('thing = ()[0]\n', 'index out of range'),
    (EFFECT + 'thing = effect("time_delay")\n', 'effect time_delay already'),
    ('import sys\nsys.exit(3)\n', '3'),
    (EFFECT + 'thing = [effect("fine"), None]\n', 'not an Effect'),
    (EFFECT + 'class thing(Plain):\n    def __init__(self):\n        self.name = "bare"\n'
     '        self.scope = "leg"\n', "scope is 'leg'"),
    (EFFECT + 'thing = Effect\n', 'columns'),
    (EFFECT + 'thing = effect("a\\x1bb")\n', 'letters, digits'))


def test_broken_plug_ins_are_skipped_and_named(tmp_path):
    for k, (source, _) in enumerate(BROKEN):
        plug_in(tmp_path / 'one', f'bad{k}', source, f'broken{k}\x1b[31m = bad{k}:thing')
    plug_in(tmp_path / 'two', 'good', EFFECT + 'thing = effect("good")\n', 'good = good:thing')
    names, skipped = ask(tmp_path / 'one', tmp_path / 'two')
    assert names == [*library_effects(), 'good']
    assert len(skipped) == len(BROKEN)
    for k, (_, reason) in enumerate(BROKEN):
        line, = (each for each in skipped if f'broken{k}\\x1b' in each)
        assert reason in line and '\n' not in line and '\x1b' not in line


def test_one_name_belongs_to_one_plug_in(tmp_path):
    for folder in ('one', 'two'):
        plug_in(tmp_path / folder, folder, EFFECT + 'thing = effect("same")\n',
                f'same = {folder}:thing')
    names, skipped = ask(tmp_path / 'one', tmp_path / 'two')
    assert names.count('same') == 1
    assert len(skipped) == 1 and 'two' in skipped[0] and 'same already' in skipped[0]


@pytest.mark.parametrize('columns, message', [
    (lambda motion, joint, setting: motion.qdd[:, joint] / setting['none'], "fails: 'none'"),
    (lambda motion, joint, setting: motion.qdd, 'must be'),
    (lambda motion, joint, setting: motion.qdd[:, [joint]] * np.nan, 'finite'),
])
def test_a_plug_in_that_fails_on_a_motion_is_untestable_there(columns, message):
    motion = clean_motion('six_axis')
    bad = guarded(type('Bad', (TorqueOffset,), {
        'name': 'bad', 'columns': lambda self, *given: columns(*given)})())
    assert message in bad.untestable(motion, 0)
    good = guarded(TorqueRipple())
    assert good.untestable(motion, 0) is None


def test_a_guarded_effect_keeps_its_own_methods():
    """Also the torque, which may be cheaper than all columns times the coefficients."""
    effect = guarded(type('Own', (TorqueOffset,), {
        'name': 'own', 'torque': lambda self, motion, joint, setting, values: 7.0})())
    motion = clean_motion('six_axis')
    assert effect.untestable(motion, 0) is None
    assert effect.torque(motion, 0, {}, np.ones(1)) == 7.0


def test_an_effect_is_found_by_its_name():
    assert known_effect('time_delay') is all_effects()['time_delay']
    with pytest.raises(OptionError, match="no effect 'gremlins'; known are coulomb_friction"):
        known_effect('gremlins')
    # The caller cannot change the registry.
    all_effects().clear()
    assert 'time_delay' in all_effects()


def test_the_page_of_effects_is_that_of_the_library():
    page = (ROOT / 'docs' / 'effects.md').read_text(encoding='utf-8')
    assert page == make_effects.document(), (
        'python3 docs/make_effects.py > docs/effects.md')
    headings = {line[3:] for line in page.splitlines() if line.startswith('## ')}
    assert headings == set(library_effects())
    assert {part.split(')')[0] for part in page.split('](#')[1:]} <= headings
