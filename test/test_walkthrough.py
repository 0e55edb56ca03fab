"""The commands of the walk-through: hidden friction is identified, added, and the error falls."""

import importlib.util
import json
from pathlib import Path
import re
import shlex

from gravity_comp_ros.cli import main
from gravity_comp_ros.models.model_file import load_model
import pytest

DOCS = Path(__file__).resolve().parent.parent / 'docs'
JOINT, FRICTION, NOISE = 'iiwa_joint_4', 0.8, 0.1


def script():
    """Return the module that makes the page."""
    spec = importlib.util.spec_from_file_location('walk', DOCS / 'make_walkthrough.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


COMMANDS = script().commands()


@pytest.fixture(scope='module')
def walk(tmp_path_factory):
    """Run every command of the page with --json; return the reports and the folder."""
    folder = tmp_path_factory.mktemp('walk')
    answers = []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for number, command in enumerate(COMMANDS):
            report = folder / f'{number}.json'
            argv = [*shlex.split(command)[1:], '--json', str(report)]
            assert main(argv) == 0, command
            if 'add' in argv and '--undo' not in argv:
                (folder / 'with_effect.json').write_bytes((folder / 'arm.json').read_bytes())
            answers.append((command, json.loads(report.read_text())))
    return answers, folder


def answers_of(walk, verb):
    return [answer for command, answer in walk[0] if shlex.split(command)[1] == verb]


def test_the_page_shows_the_commands_of_the_script():
    commands = re.findall(r'^\$ (.*)$', (DOCS / 'walkthrough.md').read_text(), flags=re.MULTILINE)
    assert commands == COMMANDS


def test_compare_shows_the_joint_with_the_friction(walk):
    before = answers_of(walk, 'compare')[0]
    assert before['worst_joint'] == JOINT
    assert before['joints'][JOINT]['rmse'] == pytest.approx(FRICTION, rel=0.1)


def test_diagnose_names_the_friction_and_its_size(walk):
    diagnosis = answers_of(walk, 'diagnose')[0]
    frictions = [f for f in diagnosis['findings'] if 'friction' in (f['effect'] or '')]
    assert [(f['joint'], f['effect'], f['verdict']) for f in frictions] == [
        (JOINT, 'coulomb_friction', 'established')]
    coefficient = frictions[0]['coefficients']['F_c']
    low, high = coefficient['ci95']
    assert coefficient['unit'] == 'N·m' and low < FRICTION < high and high - low < 0.1
    assert 'Coulomb friction on joint iiwa_joint_4' in diagnosis['verdict']
    command = f'gravity_comp add coulomb_friction:{JOINT} --model arm.json run1.mcap run2.mcap'
    assert frictions[0]['next_step'] == command and command in COMMANDS


def test_the_added_friction_reduces_the_held_out_error_to_the_noise(walk):
    held_out = answers_of(walk, 'add')[0]['held_out'][JOINT]
    assert held_out['rmse_before'] == pytest.approx(FRICTION, rel=0.1)
    # Each run is predicted by a model fitted to the other one alone.
    assert held_out['rmse_after'] < 2.0 * NOISE


def test_compare_shows_the_smaller_error(walk):
    before, after = (answer['joints'] for answer in answers_of(walk, 'compare'))
    assert after[JOINT]['rmse'] < 1.2 * NOISE
    for name, figures in after.items():
        assert figures['rmse'] < 1.05 * before[name]['rmse'], name


def test_the_model_file_records_addition_and_undo(walk):
    folder = walk[1]
    model = load_model(folder / 'with_effect.json')
    assert [effect.target for effect in model.applied.effects] == [f'coulomb_friction:{JOINT}']
    step = model.history[-1]
    assert step.action == 'added' and step.after[JOINT] < 0.25 * step.before[JOINT]
    back = load_model(folder / 'arm.json')
    assert not back.applied.effects
    assert [step.action for step in back.history] == ['added', 'removed']
