"""`convert` of a table to a bag, and one line for invalid input."""


from bench.shared.command_line import refused
from gravity_comp_ros.cli import main
from gravity_comp_ros.recordings.bag import read_bag
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


@pytest.mark.parametrize(('change', 'arguments', 'message'), [
    (('', ''), (), 'no column of time'), (('5', 'five'), ('--rate', '9'), 'is not a number'),
    (('q_1', 'q_7'), ('--rate', '9'), 'numbered 0, 7'),
    (('', ''), ('--rate', '9', '--effort-unit', 'A'), 'torque constant'),
    (('', ''), ('--rate', '9', '--effort-sign', '1,1,1'), '3 effort signs for 2 joints'),
    (('', ''), ('--rate', '9', '--time', 'q_0'), 'not both'),
    (('', ''), ('--rate', '9', '--delimiter', '::'), 'one character')])
def test_bad_input_gives_one_line_and_keeps_the_file(table, tmp_path, capsys, change, arguments,
                                                     message):
    table.write_text(TEXT.replace(*change) if change[0] else TEXT)
    out = tmp_path / 'x.mcap'
    out.write_bytes(b'old')
    assert message in refused(capsys, 'convert', table, *arguments, '-o', out)
    assert out.read_bytes() == b'old'
