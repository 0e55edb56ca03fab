"""`convert`, `cut` and `replay`: recordings made of tables and of recordings."""

from dataclasses import replace

from bench.shared.command_line import run_json
from bench.shared.recordings import messages, motion, NAMES, write_folder
import gravity_comp_ros as gc
from gravity_comp_ros import cli
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.runs import session_time
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.recordings.bag import (
    read_bag, ReadOptions, RecordedDescription, robot_description)
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
import numpy as np
import pytest

TEXT = 'q_0,q_1,tau_0,tau_1\n' + '\n'.join(
    f'{0.01 * k},{-0.02 * k},{k},{2 * k}' for k in range(40)) + '\n'


@pytest.fixture
def table(tmp_path):
    path = tmp_path / 'log.csv'
    path.write_text(TEXT)
    return path


def test_table_to_bag(table, tmp_path, capsys):
    out = tmp_path / 'x.mcap'
    assert main(['convert', str(table), '--rate', '100', '--effort-sign=-1,1',
                 '--joint-names', 'a,b', '-o', str(out)]) == 0
    printed = capsys.readouterr()
    assert '40 samples' in printed.out and 'joints a, b' in printed.out
    assert 'no velocity in the table' in printed.err
    recording = read_bag(out)
    k = np.arange(40.0)
    assert recording.samples.names == ('a', 'b')
    np.testing.assert_allclose(recording.samples.t, k / 100, atol=1e-9)
    np.testing.assert_allclose(recording.samples.tau, np.stack([-k, 2 * k], axis=1))
    np.testing.assert_allclose(recording.samples.qd, np.tile([1.0, -2.0], (40, 1)))
    assert recording.report.velocity == 'differentiated'


START = 1_700_000_000_000_000_000


@pytest.fixture
def bag(tmp_path):
    t = np.arange(300) * 0.02
    values = np.column_stack([np.sin(t), np.cos(t)])
    path = tmp_path / 'run.mcap'
    write_bag(path, [JointTopic('/joint_states', ('a', 'b'), t, values, values[:, ::-1] * [1, -1],
                                5 * values)],
              START)
    return path


def test_a_part_has_the_samples_between_two_times(bag, tmp_path):
    out = tmp_path / 'part.mcap'
    assert cli.main(['cut', str(bag), '-o', str(out), '--from', '1', '--to', '2.5']) == 0
    whole, part = read_bag(bag), read_bag(out)
    inside = (whole.samples.t >= 1.0) & (whole.samples.t <= 2.5)
    for name in ('q', 'qd', 'tau'):
        np.testing.assert_array_equal(getattr(part.samples, name),
                                      getattr(whole.samples, name)[inside])
    assert part.report.start_ns == START + 1_000_000_000
    assert part.report.topic == '/joint_states'


def test_parts_of_a_split_make_up_the_whole_on_one_clock(bag, tmp_path, capsys):
    out = tmp_path / 'part.mcap'
    result = run_json(capsys, 'cut', bag, '-o', out, '--split', '2,4', '--joints', 'b,a')
    files = [part['output'] for part in result['parts']]
    assert [part['n_samples'] for part in result['parts']] == [100, 100, 100]
    assert files == [str(tmp_path / f'part-{k}.mcap') for k in (1, 2, 3)]
    parts, whole = gc.read(files), read_bag(bag)
    # The joints are in the requested order.
    assert parts.samples.names == ('b', 'a')
    np.testing.assert_array_equal(parts.samples.tau, whole.samples.tau[:, ::-1])
    np.testing.assert_allclose(session_time(parts.samples), whole.samples.t, atol=1e-6)


def test_each_part_keeps_the_robot_description(bag, tmp_path):
    text = RecordedDescription('<robot name="Ärmchen"/>', '/arm/robot_description', bag)
    topic = JointTopic('/joint_states', ('a',), np.arange(9.0), *np.zeros((3, 9, 1)))
    write_bag(bag, [topic], START, description=text)
    assert cli.main(['cut', str(bag), '-o', str(tmp_path / 'part.mcap'), '--split', '4']) == 0
    for path in (tmp_path / 'part-1.mcap', tmp_path / 'part-2.mcap'):
        assert robot_description(path) == replace(text, path=path)


def test_the_input_recording_is_not_overwritten(bag, capsys):
    before = bag.read_bytes()
    assert cli.main(['cut', str(bag), '-o', str(bag), '--to', '1']) == 1
    assert cli.main(['cut', str(bag.rename(bag.with_stem('run-1'))), '-o', str(bag),
                     '--split', '1']) == 1
    assert bag.with_stem('run-1').read_bytes() == before


def test_a_copy_of_a_recording_counts_once(bag, tmp_path):
    copy = tmp_path / 'copy.mcap'
    copy.write_bytes(bag.read_bytes())
    both = gc.read([bag, copy], gate=None)
    assert both.n_runs == 1 and len(both.samples) == 300
    assert any('copy.mcap is a copy of this recording' in note for note in both.reports[0].notes)


TIMES, Q, QD, TAU = motion()


@pytest.fixture
def wrist(tmp_path):
    """Save and return a model with tau_wrist = 2 sin(q_elbow) and tau_elbow = 0."""
    # Base 3, first joint first: the feature of one sine at the last of two joints is 1.
    terms = (Expansion(np.array([1]), np.array([2.0])), Expansion(np.empty(0), np.empty(0)))
    stored = GravityModel(('wrist', 'elbow'), 'per_joint', terms, None, np.zeros(2),
                          Coverage(np.array([-9.0, 0.9]), np.array([9.0, 9.0]), 10))
    save_model(tmp_path / 'm.json', stored)
    return stored


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / 'bag', {'/joint_states': messages()})


def topics(path):
    return {name: read_bag(path, ReadOptions(topic=name)) for name in (
        '/joint_states', '/gravity_comp/prediction', '/gravity_comp/residual')}


def test_three_consistent_topics(tmp_path, folder, wrist, capsys):
    out = tmp_path / 'out.mcap'
    assert main(['replay', str(folder), '--model', str(tmp_path / 'm.json'), '-o', str(out)]) == 0
    printed = capsys.readouterr()
    assert '150 messages' in printed.out and 'wrist' in printed.out
    assert f'{100 * (Q[:, 1] < 0.9).mean():.0f} % of the samples are outside' in printed.err
    messages = topics(out)
    measured, predicted, residual = (messages[name].samples for name in messages)
    assert measured.names == predicted.names == residual.names == ('wrist', 'elbow')
    columns = [NAMES.index('wrist'), NAMES.index('elbow')]
    np.testing.assert_array_equal(measured.tau, TAU[:, columns])
    np.testing.assert_array_equal(measured.qd, QD[:, columns])
    np.testing.assert_array_equal(predicted.q, Q[:, columns])
    expected = wrist.predict(Q[:, columns])
    np.testing.assert_array_equal(predicted.tau, expected)
    np.testing.assert_array_equal(residual.tau, TAU[:, columns] - expected)
    starts = {recording.report.start_ns for recording in messages.values()}
    assert starts == {read_bag(folder).report.start_ns}
