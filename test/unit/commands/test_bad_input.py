"""Wrong input of users: one line of error message, and no output file."""

import json

from bench.shared.command_line import refused, run_json
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.joint_names import joint_named
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
import numpy as np
import pytest

T = np.arange(500) / 5.0
Q = np.column_stack([0.6 * np.sin(0.1 * T), 0.7 * np.cos(0.07 * T)])
QD = np.column_stack([0.06 * np.cos(0.1 * T), -0.049 * np.sin(0.07 * T)])
TAU = np.column_stack([10 * np.sin(Q[:, 0]) + 3 * np.sin(Q.sum(axis=1)),
                       3 * np.sin(Q.sum(axis=1))]) \
    + np.random.default_rng(0).normal(scale=0.05, size=(500, 2))


def bag(path, t=T, q=Q, tau=TAU):
    write_bag(path, [JointTopic('/joint_states', ('shoulder', 'elbow'), t, q, QD[:len(t)], tau)])
    return str(path)


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp('files')
    model = str(folder / 'arm.json')
    good = bag(folder / 'good.mcap')
    assert main(['fit', good, '-o', model]) == 0
    (folder / 'log.csv').write_text('t,q_1,tau_1\n0,0,1\n1,1,2\n')
    return {'GOOD': good, 'MODEL': model, 'CSV': str(folder / 'log.csv')}


@pytest.mark.parametrize(('status', 'call', 'message'), [
    (2, 'synth --tilt 90 900 -o NEW.mcap', 'not within -180 to 180'),
    (2, 'synth --samples 0 -o NEW.mcap', 'not a positive integer'),
    (1, 'synth --duration 1e9 -o NEW.mcap', 'shorten --duration or lower --rate'),
    (1, 'info GOOD --all-samples --max-speed 1', 'omit --max-speed and --rate'),
    (2, 'add coulomb_friction viscous_friction GOOD --model MODEL', 'separate effects with comma'),
    (1, 'fit CSV', 'is a table, not a recording: first `gravity_comp convert '),
    (1, 'workbench GOOD nofile.mcap --no-browser', 'no such recording: nofile.mcap'),
    (1, 'fit GOOD --joints 1,3', 'no joint 3 (to be read); it has shoulder, elbow'),
    (1, 'fit GOOD --joints 2,elbow', 'a joint is named twice'),
    (1, 'add coulomb_friction:3 GOOD --model MODEL', 'it has shoulder, elbow, or 1 to 2')])
def test_errors_are_one_line_and_write_nothing(files, tmp_path, capsys, monkeypatch, status, call,
                                               message):
    monkeypatch.chdir(tmp_path)
    argv = (files.get(word, word) for word in call.split())
    assert message in refused(capsys, *argv, status=status)
    assert not list(tmp_path.iterdir())


def test_a_recording_may_have_the_name_of_an_effect(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    bag('coulomb_friction')
    assert main(['info', 'coulomb_friction']) == 0


@pytest.mark.parametrize('call', [
    'info GOOD --joints 2,1', 'compare GOOD --model MODEL --joints 2,1'])
def test_a_joint_is_a_name_or_a_number_in_every_verb(files, capsys, call):
    argv = [files.get(word, word) for word in call.split()]
    results = []
    for joints in ('2,1', 'elbow,shoulder'):
        document = run_json(capsys, *(joints if word == '2,1' else word for word in argv))
        results.append(document.get('recordings', [document])[0]['joints'])
    assert list(results[0]) == ['elbow', 'shoulder'] and results[0] == results[1]


def test_effort_scale_and_effect_by_joint_number(files, capsys):
    facts = run_json(capsys, 'info', files['GOOD'], '--effort-scale', '2=-1')['recordings'][0]
    assert facts['effort_scale'] == {'elbow': -1.0}
    result = run_json(capsys, 'add', 'torque_offset:2', files['GOOD'], '--model', files['MODEL'],
                      '--dry-run')
    assert result['added'] == ['torque_offset:elbow']
    # Names take precedence over numbers.
    assert joint_named('2', ('2', '1')) == '2'
    assert joint_named('2', ('a', 'b')) == 'b'
    assert joint_named('0', ('a', 'b')) is None and joint_named('x', ('a',)) is None


@pytest.mark.parametrize('what', ['q', 'tau'])
def test_values_out_of_range_are_dropped(tmp_path, capsys, what):
    corrupted = {'q': Q.copy(), 'tau': TAU.copy()}
    corrupted[what][100, 0] = 1e300
    path = bag(tmp_path / 'x.mcap', **corrupted)
    whole = read_bag(path)
    assert len(whole.samples) == 499
    assert any('1 value beyond 1e+09' in note for note in whole.report.notes)
    assert np.abs(whole.samples.tau).max() < 20
    assert main(['fit', path, '--json']) == 0
    output = capsys.readouterr()
    assert 'RuntimeWarning' not in output.err
    assert json.loads(output.out)['joints']['shoulder']['rmse'] < 0.1


def test_efforts_out_of_range_throughout_are_refused(tmp_path, capsys):
    path = bag(tmp_path / 'x.mcap', tau=1e300 * TAU)
    assert 'beyond 1e+09 in 500 of 500' in refused(capsys, 'info', path)


def test_gaps_are_noted(tmp_path):
    t = T.copy()
    t[250:] += 1000.0
    path = bag(tmp_path / 'x.mcap', t=t)
    assert any(note.startswith('a gap of 1000 s, 49.8 s after')
               for note in read_bag(path).report.notes)
    # Poses half a minute apart do not count as gaps.
    slow = bag(tmp_path / 'y.mcap', t=30.0 * np.arange(500.0))
    assert not any('gap' in note for note in read_bag(slow).report.notes)
