"""`gravity_comp cut`: parts of a recording with the clock of the whole."""


from bench.shared.command_line import refused, run_json
import gravity_comp_ros as gc
from gravity_comp_ros import cli
from gravity_comp_ros.data.runs import session_time
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
import numpy as np
import pytest

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


def test_joints_are_written_in_the_requested_order(bag, tmp_path):
    out = tmp_path / 'b.mcap'
    assert cli.main(['cut', str(bag), '-o', str(out), '--joints', 'b,a']) == 0
    assert read_bag(out).samples.names == ('b', 'a')


def test_parts_of_a_split_make_up_the_whole_on_one_clock(bag, tmp_path, capsys):
    out = tmp_path / 'part.mcap'
    result = run_json(capsys, 'cut', bag, '-o', out, '--split', '2,4')
    files = [part['output'] for part in result['parts']]
    assert [part['n_samples'] for part in result['parts']] == [100, 100, 100]
    assert files == [str(tmp_path / f'part-{k}.mcap') for k in (1, 2, 3)]
    parts, whole = gc.read(files), read_bag(bag)
    np.testing.assert_array_equal(parts.samples.tau, whole.samples.tau)
    np.testing.assert_allclose(session_time(parts.samples), whole.samples.t, atol=1e-6)


@pytest.mark.parametrize('wrong, message', [
    (['--from', '3', '--to', '2'], 'must increase'), (['--split', '4,50'], 'must increase'),
    (['--from', '0.005', '--to', '0.01'], 'no samples'), (['--joints', 'a,z'], 'z')])
def test_invalid_times_and_joints_are_refused_in_one_line(bag, tmp_path, capsys, wrong, message):
    out = tmp_path / 'part.mcap'
    assert message in refused(capsys, 'cut', bag, '-o', out, *wrong) and not out.exists()


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
