"""Tables as tools write them: topic echo, rostopic, bagpy, PlotJuggler, servos, LeRobot."""

import json

from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.table import read_table, TableOptions
from gravity_comp_ros.recordings.table_units import decoded
import numpy as np
import pytest

NAMES = ('shoulder', 'elbow', 'wrist')
COUNT = 200
T = np.arange(COUNT) / 50.0
PHASE = 0.5 * T[:, None] + np.array([0.0, 1.0, 2.0])
Q, QD, TAU = np.sin(PHASE), 0.5 * np.cos(PHASE), 10.0 * np.cos(np.sin(PHASE)) - 4.0
START = 1_700_000_000


def write(path, rows, header=None):
    lines = ([header] if header else []) + rows
    path.write_text('\n'.join(','.join(map(str, line)) for line in lines) + '\n')
    return path


def check(path, velocity=True):
    converted = read_table(path, TableOptions())
    topic = converted.topic
    assert topic.joints == NAMES
    np.testing.assert_allclose(topic.t, T, atol=1e-6)
    np.testing.assert_allclose(topic.position, Q, atol=1e-9)
    np.testing.assert_allclose(topic.effort, TAU, atol=1e-9)
    if velocity:
        np.testing.assert_allclose(topic.velocity, QD, atol=1e-9)
    else:
        assert topic.velocity is None
    return converted


@pytest.mark.parametrize('velocity', [True, False])
@pytest.mark.parametrize('frame', ['', 'base_link'])
def test_ros2_topic_echo(tmp_path, velocity, frame):
    rows = [[START + int(t), round(t % 1 * 1e9), frame, *NAMES, *q, *qd[:3 * velocity], *tau]
            for t, q, qd, tau in zip(T, Q, QD, TAU)]
    assert check(write(tmp_path / 'x.csv', rows), velocity).start_ns // 10**9 == START


def test_ros2_topic_echo_without_effort(tmp_path):
    rows = [[START + int(t), round(t % 1 * 1e9), '', *NAMES, *q, *qd]
            for t, q, qd in zip(T, Q, QD)]
    with pytest.raises(BagError, match='no columns of effort'):
        read_table(write(tmp_path / 'x.csv', rows))


def test_rostopic(tmp_path):
    header = ['%time', 'field.header.seq', 'field.header.stamp', 'field.header.frame_id'] + [
        f'field.{word}{k}' for word in ('name', 'position', 'velocity', 'effort')
        for k in range(3)]
    rows = [[START * 10**9 + round(t * 1e9), 7, 0, 'base', *NAMES, *q, *qd, *tau]
            for t, q, qd, tau in zip(T, Q, QD, TAU)]
    check(write(tmp_path / 'x.csv', rows, header))


@pytest.mark.parametrize('style', ['{}_{}', '{}[{}]', '{}.{}'])
def test_numbered_columns_with_columns_of_names(tmp_path, style):
    header = ['header.stamp.secs', 'header.stamp.nsecs'] + [
        style.format(word, k) for word in ('name', 'position', 'velocity', 'effort')
        for k in range(3)]
    rows = [[START + int(t), round(t % 1 * 1e9), *NAMES, *q, *qd, *tau]
            for t, q, qd, tau in zip(T, Q, QD, TAU)]
    path = write(tmp_path / 'x.csv', rows, header)
    check(path)
    rows[50][2:5] = rows[50][4:1:-1]
    with pytest.raises(BagError, match="line 52, column name.0.?: the joint is 'wrist' after"):
        read_table(write(path, rows, header))


@pytest.mark.parametrize('split', ['', 'by array', 'by joint'])
def test_rows_of_plotjuggler(tmp_path, split):
    header = ['__time'] + [f'/joint_states/{name}/{word}' for name in NAMES
                           for word in ('position', 'velocity', 'effort')] + ['/imu/x']
    rows = []
    for t, q, qd, tau in zip(T, Q, QD, TAU):
        values = np.stack([q, qd, tau], axis=1).ravel()
        group = {'': np.zeros(9), 'by array': np.tile([0, 0, 1], 3),
                 'by joint': np.repeat([0, 1, 2], 3)}[split]
        for number in range(int(group.max()) + 1):
            cells = [repr(float(x)) if g == number else '' for x, g in zip(values, group)]
            rows.append([f'{START + t + 1e-6 * number:.9f}', *cells, ''])
        rows.append([f'{START + t + 0.007:.9f}', *[''] * 9, 1.5])
    converted = check(write(tmp_path / 'x.csv', rows, header))
    assert any('are joined with another row' in note for note in converted.notes)


def test_a_blank_cell_of_a_single_joint_is_an_error(tmp_path):
    header = ['t', *(f'{word}_{name}' for word in ('position', 'effort') for name in NAMES)]
    rows = [[t, *q, *tau] for t, q, tau in zip(T, Q, TAU)]
    rows[70][2] = ''
    with pytest.raises(BagError, match='line 72.*position_elbow: empty'):
        read_table(write(tmp_path / 'x.csv', rows, header))


@pytest.mark.parametrize('torque', ['torque', 'eff', 'current'])
@pytest.mark.parametrize('unit, size', [('ms', 1000), ('us', 10**6), ('s', 1)])
def test_the_name_of_the_time_has_its_unit_and_rows_repeat(tmp_path, torque, unit, size):
    head = [f'timestamp_{unit}', *(f'{name}_{what}' for what in ('pos', torque) for name in NAMES)]
    rows = [[round(size * (t + 1234.5), 3), *q, *tau] for t, q, tau in zip(T, Q, TAU)]
    twice = [row for row in rows for _ in range(2)]
    converted = check(write(tmp_path / 'x.csv', twice, head), velocity=False)
    assert any('200 of 400 rows are joined with another' in note for note in converted.notes)
    # The same time with other values is no repetition.
    other = [*rows[:10], [*rows[9][:-1], 0.5], *rows[10:]]
    with pytest.raises(BagError, match='time does not increase .*--skip-bad-rows'):
        check(write(tmp_path / 'x.csv', other, head))


def registers(values, bit):
    return np.where(values < 0, 2 ** bit - values, values).astype(int)


@pytest.mark.parametrize('effort', ['load', 'current'])
def test_servo_registers(tmp_path, effort):
    position = np.round(Q * 2048 / np.pi) - [0, 900, 1500]
    load = np.round(TAU / [12, 6, 30] * 1000)
    header = ['timestamp', *(f'{name}.{word}' for word in ('pos', effort) for name in NAMES)]
    rows = [[t, *p, *x] for t, p, x in zip(T, registers(position, 15), registers(load, 10))]
    path = write(tmp_path / 'x.csv', rows, header)
    with pytest.raises(BagError, match='counts of an encoder. Give --position-unit ticks=4096'):
        read_table(path)
    options = TableOptions(position_unit='ticks=4096', effort_unit='permille',
                           rated_torque=(12.0, 6.0, 30.0))
    converted = read_table(path, options)
    turns = np.array([0, 900, 1500]) * np.pi / 2048
    np.testing.assert_allclose(converted.topic.position, Q - turns, atol=1e-3)
    np.testing.assert_allclose(converted.topic.effort, TAU, atol=0.02)
    assert 'position is read as registers with sign bit 15' in converted.notes


@pytest.mark.parametrize(('encode', 'name'), [
    (lambda x: registers(x, 15), 'sign bit 15'), (lambda x: registers(x, 10), 'sign bit 10'),
    (lambda x: x.astype(int) % 2**16, '16-bit complement'),
    (lambda x: x.astype(int) % 2**32, '32-bit complement')])
def test_encodings_of_signed_numbers(encode, name):
    values = np.round(np.column_stack([900 * np.sin(T), 40 + 20 * np.cos(T), -300 + 50 * T]))
    signed, encoding = decoded(encode(values).astype(float))
    assert encoding == name
    np.testing.assert_array_equal(signed, values)


def test_counts_without_sign_are_not_changed():
    values = np.round(np.column_stack([2048 + 1500 * np.sin(T), 3000 + 1000 * np.cos(T)]))
    assert decoded(values)[1] == '' and decoded(values + 0.5)[1] == ''


def data_set(folder, features, columns):
    pyarrow = pytest.importorskip('pyarrow')
    from pyarrow import parquet
    (folder / 'meta').mkdir(parents=True)
    (folder / 'data' / 'chunk-000').mkdir(parents=True)
    (folder / 'meta' / 'info.json').write_text(json.dumps({'features': features}))
    parquet.write_table(pyarrow.table(columns),
                        folder / 'data' / 'chunk-000' / 'episode_000000.parquet')
    return folder


@pytest.mark.parametrize('whole', [True, False])
def test_a_lerobot_data_set_with_one_list(tmp_path, whole):
    names = [f'{name}.{word}' for name in NAMES for word in ('pos', 'vel', 'load')]
    state = np.stack([Q, QD, TAU], axis=2).reshape(COUNT, 9)
    folder = data_set(tmp_path / 'set', {'observation.state': {'names': names}}, {
        'observation.state': list(state), 'action': list(Q), 'timestamp': T,
        'episode_index': np.zeros(COUNT, dtype=int), 'task': ['pick'] * COUNT})
    path = folder if whole else folder / 'data' / 'chunk-000' / 'episode_000000.parquet'
    check(path)


def test_a_lerobot_data_set_with_a_list_for_each_quantity_and_episodes(tmp_path):
    motors = {'motors': list(NAMES)}
    features = {f'observation.{word}': {'names': motors}
                for word in ('state', 'velocity', 'effort')}
    folder = data_set(tmp_path / 'set', features, {
        'observation.state': list(Q), 'observation.velocity': list(QD),
        'observation.effort': list(TAU), 'timestamp': np.tile(T[:100], 2),
        'episode_index': np.repeat([0, 1], 100)})
    topic = read_table(folder).topic
    assert topic.joints == NAMES and topic.t[100] - topic.t[99] == 60.0
    np.testing.assert_array_equal(topic.effort, TAU)


def test_a_data_set_without_torque_is_refused(tmp_path):
    folder = data_set(tmp_path / 'set', {'observation.state': {
        'names': [f'{name}.pos' for name in NAMES]}}, {
            'observation.state': list(Q), 'timestamp': T})
    with pytest.raises(BagError, match='no columns of .*shoulder.pos'):
        read_table(folder)
    (folder / 'meta' / 'info.json').write_text('{}')
    with pytest.raises(BagError, match='info.json is not the information of a LeRobot data set'):
        read_table(folder)


def test_dates_and_missing_lists_of_a_parquet_file(tmp_path):
    pyarrow = pytest.importorskip('pyarrow')
    from pyarrow import parquet
    path, t = tmp_path / 'x.parquet', 0.02 * np.arange(100)
    stamps = np.datetime64('2024-05-01T10:00:00', 'ns') + (t * 1e9).astype('timedelta64[ns]')
    lists = [[x, 2.0 * x] for x in np.sin(t).tolist()]
    columns = {'time': pyarrow.array(stamps, pyarrow.timestamp('ns', 'UTC')), 'effort': lists}
    parquet.write_table(pyarrow.table({**columns, 'position': lists}), path)
    converted = read_table(path)
    assert converted.start_ns == pytest.approx(1714557600 * 10**9, abs=1000)
    np.testing.assert_allclose(converted.topic.t, t, atol=1e-6)
    parquet.write_table(pyarrow.table({**columns, 'position': [None, *lists[1:]]}), path)
    with pytest.raises(BagError, match='row 1, column position_1: empty or not a number'):
        read_table(path)


def test_a_damaged_parquet_file_is_refused(tmp_path):
    pytest.importorskip('pyarrow')
    (tmp_path / 'x.parquet').write_bytes(b'PAR1 nothing')
    with pytest.raises(BagError, match='x.parquet cannot be read as Parquet'):
        read_table(tmp_path / 'x.parquet')
