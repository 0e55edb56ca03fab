"""Drift between two models of one arm, in numbers and on the command line."""

from dataclasses import replace
import json

from bench.shared.rough_links import JOINTS, two_links
from gravity_comp_ros.cli import main
from gravity_comp_ros.errors import ModelMismatchError, OptionError
from gravity_comp_ros.evaluation.drift import drift, DriftOptions
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import joint_states, write_bag
import numpy as np
import pytest


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """
    Return a folder with a.json and b.json of the same arm, and c.json of a changed one.

    The changed arm has 2.5 times the friction, and a mass that is 2 N·m at the elbow.
    """
    folder = tmp_path_factory.mktemp('drift')
    for name, seed in (('a', 1), ('b', 2), ('c', 3)):
        samples = two_links(seed, rough=2.5 if name == 'c' else 1.0)
        if name == 'c':
            both = 2.0 * np.sin(samples.q.sum(axis=1))
            samples = replace(samples, tau=samples.tau + both[:, None])
        write_bag(folder / f'{name}.mcap', [joint_states(samples)])
        assert main(['fit', str(folder / f'{name}.mcap'), '-o', str(folder / f'{name}.json')]) == 0
    return folder


def test_the_same_arm_has_not_drifted_and_a_changed_one_has(folder):
    a, b, c = (load_model(folder / f'{name}.json') for name in 'abc')
    poses = two_links(4)
    same, changed = drift(a, b, poses), drift(a, c, poses)
    assert not any(one.drifted for one in (*same.joints.values(), *same.coefficients))
    torque = 2.0 * np.sin(poses.q.sum(axis=1))
    for name in JOINTS:
        assert changed.joints[name].drifted
        assert changed.joints[name].rms == pytest.approx(np.sqrt((torque ** 2).mean()), rel=0.4)
    viscous, = (one for one in changed.coefficients if one.symbol == 'F_v'
                and one.target == 'viscous_friction:shoulder')
    assert viscous.drifted
    assert viscous.before.value == pytest.approx(5.0, rel=0.2)
    assert viscous.after.value == pytest.approx(12.5, rel=0.2)


def test_other_joints_and_wrong_options_are_refused(folder):
    a = load_model(folder / 'a.json')
    other = replace(a, joints=('x', 'y'), geometry=None, applied=type(a.applied)(),
                    fitted=type(a.fitted)())
    with pytest.raises(ModelMismatchError, match='different joints'):
        drift(other, a, two_links(4))
    for wrong in (0.0, float('nan'), float('inf')):
        with pytest.raises(OptionError, match='significance'):
            DriftOptions(wrong)


def test_compare_shows_the_drift_in_the_terminal_and_as_json(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    command = ['compare', 'b.mcap', '--model', 'c.json', '--previous', 'a.json']
    assert main(command) == 0
    out = capsys.readouterr().out
    assert 'change of the static torque since a.json' in out
    assert 'viscous_friction:shoulder F_v: 5' in out and '→ 12' in out
    assert main([*command, '--json']) == 0
    previous = json.loads(capsys.readouterr().out)['previous']
    assert previous['model'] == 'a.json' and previous['joints']['elbow']['drifted']
    assert any(one['drifted'] and one['symbol'] == 'F_v' for one in previous['coefficients'])
    assert main(['compare', 'a.mcap', '--model', 'b.json', '--previous', 'a.json']) == 0
    assert 'no coefficient of an effect drifted' in capsys.readouterr().out
    assert main([*command[:-1], 'missing.json']) == 1
    assert 'missing.json' in capsys.readouterr().err
