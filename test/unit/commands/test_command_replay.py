"""`replay` writes consistent measured, predicted and residual torque."""


from bench.shared.command_line import refused
from bench.shared.recordings import messages, motion, NAMES, write_folder
from gravity_comp_ros.cli import main
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.model_file import save_model
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
import numpy as np
import pytest

T, Q, QD, TAU = motion()


@pytest.fixture
def model(tmp_path):
    """Save and return a model with tau_wrist = 2 sin(q_elbow) and tau_elbow = 0."""
    # Base 3, first joint first: the feature of one sine at the last of two joints is 1.
    terms = (Expansion(np.array([1]), np.array([2.0])), Expansion(np.empty(0), np.empty(0)))
    stored = GravityModel(('wrist', 'elbow'), 'per_joint', terms, None, np.zeros(2),
                          Coverage(np.array([-9.0, 0.9]), np.array([9.0, 9.0]), 10))
    save_model(tmp_path / 'm.json', stored)
    return stored


@pytest.fixture
def bag(tmp_path):
    return write_folder(tmp_path / 'bag', {'/joint_states': messages()})


def topics(path):
    return {name: read_bag(path, ReadOptions(topic=name)) for name in (
        '/joint_states', '/gravity_comp/prediction', '/gravity_comp/residual')}


def test_three_consistent_topics(tmp_path, bag, model, capsys):
    out = tmp_path / 'out.mcap'
    assert main(['replay', str(bag), '--model', str(tmp_path / 'm.json'), '-o', str(out)]) == 0
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
    expected = model.predict(Q[:, columns])
    np.testing.assert_array_equal(predicted.tau, expected)
    np.testing.assert_array_equal(residual.tau, TAU[:, columns] - expected)
    starts = {recording.report.start_ns for recording in messages.values()}
    assert starts == {read_bag(bag).report.start_ns}


def test_the_input_recording_is_never_overwritten(tmp_path, bag, model, capsys):
    single = tmp_path / 'x.mcap'
    write_bag(single, [JointTopic('/joint_states', NAMES, T, Q, QD, TAU)])
    link = tmp_path / 'link.mcap'
    link.symlink_to(single)
    before = single.read_bytes()
    for source, out in ((single, single), (single, link), (bag, bag / 'out.mcap')):
        assert main(['replay', str(source), '--model', str(tmp_path / 'm.json'),
                     '-o', str(out)]) == 1
        assert 'name a' in capsys.readouterr().err
    assert single.read_bytes() == before
    assert not (bag / 'out.mcap').exists()


@pytest.mark.parametrize(('arguments', 'message'), [
    (('--joints', 'wrist,shoulder'), 'no joint elbow'), (('--topic', '/x'), 'no topic /x'),
    (('--model', 'none.json'), 'none.json')])
def test_one_line_for_a_mismatch(tmp_path, bag, model, capsys, arguments, message):
    out = tmp_path / 'out.mcap'
    assert message in refused(capsys, 'replay', bag, '--model', tmp_path / 'm.json', '-o', out,
                              *arguments)
    assert not out.exists()
