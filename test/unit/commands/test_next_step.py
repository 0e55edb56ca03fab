"""Printed next commands run unchanged, on the same files with the same reading options."""

import shlex

from gravity_comp_ros.cli import main
from gravity_comp_ros.models.model_file import load_model
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
import numpy as np
import pytest


@pytest.fixture
def table(tmp_path, monkeypatch):
    """Return a CSV of two joints with friction on the second, efforts in mN·m and reversed."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(1500) * 0.08
    q = np.column_stack([0.9 * np.sin(0.13 * t), 1.0 * np.sin(0.11 * t + 0.7)])
    qd = np.gradient(q, t, axis=0)
    elbow = 4.0 * np.sin(q.sum(axis=1))
    friction = 0.8 * np.tanh(qd[:, 1] / 0.005)
    tau = np.column_stack([10.0 * np.sin(q[:, 0]) + elbow, elbow + friction])
    tau += np.random.default_rng(0).normal(scale=0.03, size=tau.shape)
    path = tmp_path / 'my log.csv'
    np.savetxt(path, np.column_stack([t, q, qd, -1000 * tau]), delimiter=',', comments='',
               header='t,q_1,q_2,qd_1,qd_2,tau_1,tau_2')
    return path


def printed(capsys, argv):
    """Run a call and return the printed commands."""
    capsys.readouterr()
    assert main(argv) == 0
    return [shlex.split(line)[1:] for line in capsys.readouterr().out.splitlines()
            if line.startswith('  gravity_comp ')]


def test_from_a_table_to_an_effect_by_the_printed_commands_alone(table, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '60')   # commands are not wrapped
    (info,) = printed(capsys, ['convert', 'my log.csv', '-o', 'my run.mcap'])
    assert info == ['info', 'my run.mcap']
    (fit,) = printed(capsys, [*info, '--effort-unit', 'mNm', '--effort-scale', '1=-1,2=-1'])
    (diagnose,) = printed(capsys, fit)
    (add,) = printed(capsys, diagnose)
    assert add[:2] == ['add', 'coulomb_friction:joint_2']
    undo, again = printed(capsys, add)
    model = load_model('arm.json')
    friction = model.applied.effects[0].coefficients['F_c'].value
    assert friction == pytest.approx(0.8, abs=0.05)
    assert printed(capsys, undo) == [] and not load_model('arm.json').applied.effects
    assert again == diagnose


def test_an_existing_model_is_not_overwritten(table, capsys):
    write_bag('x.mcap', [JointTopic('/joint_states', ('a',), *(
        lambda t: (t, np.sin(0.1 * t)[:, None], 0.1 * np.cos(0.1 * t)[:, None],
                   np.sin(np.sin(0.1 * t))[:, None] * 5))(np.arange(300) / 5.0))])
    with open('arm.json', 'w') as stream:
        stream.write('{}')
    (fit,) = printed(capsys, ['fit', 'x.mcap'])
    assert fit == ['fit', 'x.mcap', '-o', 'arm_2.json']
    compare, _ = printed(capsys, [*fit, '--holdout'])
    assert '--holdout' in compare
    (diagnose,) = printed(capsys, compare)
    assert diagnose == ['diagnose', 'x.mcap', '--model', 'arm_2.json']
