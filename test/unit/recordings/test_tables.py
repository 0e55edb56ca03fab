"""Conversion of tables with any columns, units and signs, and its errors."""

from gravity_comp_ros.errors import BagError, OptionError
from gravity_comp_ros.recordings.mcap_writer import DEFAULT_START_NS
from gravity_comp_ros.recordings.table import read_table, TableOptions
import numpy as np
import pytest

T = np.array([0.0, 0.1, 0.2])
Q = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])
TAU = np.array([[1.0, -2.0], [3.0, -4.0], [5.0, -6.0]])


def csv(tmp_path, text, name='x.csv'):
    path = tmp_path / name
    path.write_text(text)
    return path


def table_text(header='t,q_0,q_1,tau_0,tau_1', delimiter=',', values=None):
    values = np.column_stack([T, Q, TAU]) if values is None else values
    lines = [delimiter.join(repr(float(v)) for v in row) for row in values]
    return '\n'.join(([header] if header else []) + lines) + '\n'


def check_is_the_table(converted):
    topic = converted.topic
    assert topic.joints == ('joint_1', 'joint_2')
    np.testing.assert_allclose(topic.t, T)
    np.testing.assert_array_equal(topic.position, Q)
    np.testing.assert_array_equal(topic.effort, TAU)
    assert topic.velocity is None
    assert converted.start_ns == DEFAULT_START_NS
    assert any('no velocity' in note for note in converted.notes)


@pytest.mark.parametrize(('header', 'delimiter'), [
    ('t,q_0,q_1,tau_0,tau_1', ','), ('time;q1;q2;tau1;tau2', ';'),
    ('t\tpos_1\tpos_2\teffort_1\teffort_2', '\t'), ('t q_1 q_2 tau_1 tau_2', ' '),
    ('# t,q_0,q_1,tau_0,tau_1', ','), ('"t","q_0","q_1","tau_0","tau_1"', ','),
    ('\ufefft, q_0, q_1, tau_0, tau_1', ','), ('t|q_0|q_1|tau_0|tau_1', '|'),
    ('sep=;\nt;q_0;q_1;tau_0;tau_1', ';'), ('# arm 7\n# on 3 May\nt,q_0,q_1,tau_0,tau_1', ','),
    ('# arm 7, at noon\n# t,q_0,q_1,tau_0,tau_1', ',')])
def test_default_columns_need_no_options(tmp_path, header, delimiter):
    check_is_the_table(read_table(csv(tmp_path, table_text(header, delimiter))))


def test_utf16_delimiters_at_the_ends_and_times_of_day(tmp_path):
    text = table_text()
    path = tmp_path / 'x.csv'
    path.write_bytes(text.encode('utf-16'))
    check_is_the_table(read_table(path))
    first, *lines = text.splitlines()
    check_is_the_table(read_table(csv(tmp_path, '\n'.join([first, *(f'{x},' for x in lines)]))))
    timed = [f'10:30:{float(x.split(",")[0]):09.6f},{x.split(",", 1)[1]}' for x in lines]
    np.testing.assert_allclose(read_table(csv(tmp_path, '\n'.join([first, *timed]))).topic.t, T)


def test_lines_before_the_header_are_counted_in_messages(tmp_path):
    path = csv(tmp_path, '# arm 7\n' + table_text().replace('-4.0', 'abc'))
    with pytest.raises(BagError, match=r'row 2 \(line 4\), column tau_1'):
        read_table(path)


@pytest.mark.parametrize('options', [
    {'time': '1', 'position': '2-3', 'effort': '4,5'},
    {'time': '1', 'position': '2,3', 'effort': '4-5', 'header': False, 'delimiter': ','}])
def test_no_header_and_numbered_columns(tmp_path, options):
    path = csv(tmp_path, table_text(header=None))
    check_is_the_table(read_table(path, TableOptions(**options)))


def test_columns_by_name_in_any_order(tmp_path):
    path = csv(tmp_path, table_text('clock,b,a,2-3,torque of a').replace('\n', ' \n'))
    converted = read_table(path, TableOptions(
        time='clock', position='a,b', effort='torque of a,2-3', joints=('A', 'B')))
    assert converted.topic.joints == ('A', 'B')
    np.testing.assert_array_equal(converted.topic.position, Q[:, ::-1])
    np.testing.assert_array_equal(converted.topic.effort, TAU[:, ::-1])


def test_pattern_sorts_by_number_and_not_by_text(tmp_path):
    names = [f'q_{k}' for k in range(11)][::-1] + [f'tau_{k}' for k in range(11)]
    values = np.arange(66.0).reshape(3, 22) / 100
    path = csv(tmp_path, table_text(','.join(names), values=values))
    topic = read_table(path, TableOptions(rate=10.0)).topic
    np.testing.assert_array_equal(topic.position, values[:, 10::-1])
    np.testing.assert_array_equal(topic.effort, values[:, 11:])


def test_units_signs_constants_by_hand(tmp_path):
    text = 'ms,p_1,p_2,v_1,v_2,i_1,i_2\n1000,180,90,10,-20,500,250\n1250,0,45,0,0,1000,0\n'
    converted = read_table(csv(tmp_path, text), TableOptions(
        time='ms', position='p_{i}', velocity='v_{i}', effort='i_{i}', time_unit='ms',
        position_unit='deg', effort_unit='mA', torque_constant=(0.1, 0.2), gear_ratio=(100.0,),
        effort_sign=(1.0, -1.0)))
    topic = converted.topic
    np.testing.assert_allclose(topic.t, [0, 0.25])
    np.testing.assert_allclose(topic.position, [[np.pi, np.pi / 2], [0, np.pi / 4]])
    np.testing.assert_allclose(topic.velocity, np.radians([[10, -20], [0, 0]]))
    # 0.5 A * 0.1 N·m/A * 100 = 5 N·m; -(0.25 A * 0.2 N·m/A * 100) = -5 N·m
    np.testing.assert_allclose(topic.effort, [[5, -5], [10, 0]])


def test_skipped_rows_do_not_shift_the_time(tmp_path):
    text = table_text('x,q_0,q_1,tau_0,tau_1').replace('0.3', '')
    path = csv(tmp_path, text)
    with pytest.raises(BagError, match=r'x\.csv, row 2 \(line 3\), column q_0: empty'):
        read_table(path, TableOptions(rate=10.0))
    converted = read_table(path, TableOptions(rate=10.0, skip_bad_rows=True))
    assert converted.dropped == 1
    np.testing.assert_allclose(converted.topic.t, [0, 0.2])


def test_absolute_times_are_kept(tmp_path):
    values = np.column_stack([1.7e9 + T, Q, TAU])
    converted = read_table(csv(tmp_path, table_text(values=values)))
    assert converted.start_ns == 1_700_000_000 * 10**9
    np.testing.assert_allclose(converted.topic.t, T, atol=1e-6)


def test_degrees_read_as_radians_are_refused(tmp_path):
    path = csv(tmp_path, table_text(values=np.column_stack([T, 100 * Q, TAU])))
    with pytest.raises(BagError, match='are they degrees. Give --position-unit deg, or rad'):
        read_table(path)
    assert read_table(path, TableOptions(position_unit='rad')).topic.position.max() == 60.0


GOOD = table_text()


@pytest.mark.parametrize(('text', 'options', 'message'), [
    ('', {}, 'is empty'),
    ('t,q_0,tau_0\n', {}, 'no rows'),
    (GOOD.replace('-4.0', 'abc'), {},
     "line 3., column tau_1: 'abc' is not a number .--skip"),
    (GOOD.replace('-4.0', 'nan'), {}, r'row 2 \(line 3\), column tau_1: empty or not a number'),
    ('t;q_1;tau_1\n0;1.234,5;2\n1;1,5;2\n', {}, "'1.234,5' is not a number"),
    ('t,q_1,tau_1\n0,0.1,1\n1,"0,5",2\n', {}, 'for a decimal comma, separate the cells'),
    (GOOD.replace('-4.0', 'inf'), {}, r'row 2 \(line 3\), column tau_1: not finite'),
    (GOOD.replace('0.3,', ''), {}, 'line 3: 4 cells; the table has 5 columns'),
    (GOOD.replace('0.2,0.5', '0.1,0.5'), {}, r'row 3 \(line 4\): time does not increase'),
    (GOOD.replace('tau_1', 'tau_0'), {}, 'columns repeat: tau_0'),
    (GOOD.replace('t,', 'x,'), {}, 'no column of time'),
    (GOOD.replace('tau_1', 'tau_5'), {}, r'tau_\{i\} for effort are numbered 0, 5'),
    (GOOD, {'position': 'p_{i}'}, r'no column p_\{i\} for position; it has t, q_0'),
    (GOOD, {'position': 'q_0,q_9'}, "no column 'q_9' for position"),
    (GOOD, {'position': '2-9'}, "no column '2-9' for position"),
    (GOOD, {'position': 'q_0,q_0'}, 'q_0 is given twice'),
    (GOOD, {'effort': 'tau_0'}, '2 columns of position but 1 of effort'),
    (GOOD.replace('tau', 'x'), {}, 'no columns of effort such as'),
    (GOOD.replace('tau', 'current'), {}, 'no columns of effort such as'),
    ('t,q_0,tau_0\n0,1,0\n1,2,0\n', {}, 'effort is 0 throughout'),
    ('t,q_0,tau_0\n0,1,\n1,2,\n', {'skip_bad_rows': True}, 'tau_0: .* no row has a number'),
    ('t,q_0,tau_0\n3/5/26 10:30:00,1,1\n', {}, 'with a date as 2024-12-31'),
    ('t,q_0,tau_0\n' + 'x' * 200000, {}, 'line 2')])
def test_errors_name_row_and_column(tmp_path, text, options, message):
    path = csv(tmp_path, text)
    with pytest.raises(BagError, match=message) as error:
        read_table(path, TableOptions(**options))
    assert str(path) in str(error.value) and '\n' not in str(error.value)


@pytest.mark.parametrize('options', [
    {'effort_sign': (1.0, -1.0, 1.0)}, {'joints': ('a',)}, {'joints': ('a', 'a')}])
def test_wrong_number_of_joints(tmp_path, options):
    with pytest.raises(OptionError):
        read_table(csv(tmp_path, GOOD), TableOptions(**options))


def test_unreadable_files(tmp_path):
    for path in (tmp_path / 'none.csv', tmp_path):
        with pytest.raises(BagError, match='cannot read'):
            read_table(path)
    path = tmp_path / 'x.csv'
    path.write_bytes(b'\x89MCAP0\r\n')
    with pytest.raises(BagError, match='not a text file'):
        read_table(path)
