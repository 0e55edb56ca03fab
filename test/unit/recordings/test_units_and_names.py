"""Units, column names and common defects of tables: supported or refused, never guessed."""

from pathlib import Path
import tempfile

from gravity_comp_ros.api.read import read_recording
from gravity_comp_ros.cli import main
from gravity_comp_ros.data.samples import rename_hint
from gravity_comp_ros.errors import BagError, ModelMismatchError, OptionError
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
from gravity_comp_ros.recordings.table import read_table, TableOptions
from hypothesis import given, strategies as st
import numpy as np
import pytest

T = np.arange(300) * 0.02
Q = np.column_stack([np.sin(0.1 * T), np.cos(0.2 * T)])
TAU = np.column_stack([10 * Q[:, 0], 3 * Q[:, 1] + 0.5])
HEAD = 't,q_1,q_2,tau_1,tau_2'


def table(path, head=HEAD, comma=',', point='.', t=T, end=''):
    rows = np.column_stack([t, Q, TAU])
    lines = [head] if head else []
    lines += [comma.join(f'{x:.6f}'.replace('.', point) for x in row) for row in rows]
    path.write_text('\n'.join(lines) + '\n' + end)
    return path


def bag(path, q=Q, tau=TAU, names=('joint_1', 'joint_2')):
    qd = np.gradient(q, T, axis=0)
    write_bag(path, [JointTopic('/joint_states', names, T, q, qd, tau)])
    return path


@pytest.mark.parametrize('comma', [';', '\t', ' '])
@pytest.mark.parametrize('head', [HEAD, ''])
def test_a_decimal_comma(tmp_path, comma, head):
    path = table(tmp_path / 'x.csv', head.replace(',', comma), comma, ',')
    options = TableOptions() if head else TableOptions(time='1', position='2-3', effort='4-5')
    result = read_table(path, options).topic
    np.testing.assert_allclose(result.position, Q, atol=1e-6)
    np.testing.assert_allclose(result.t, T, atol=1e-6)


@pytest.mark.parametrize('end', ['6.00,0.5', '6.00,0.5,0.5,1.0,', '6.00,0.5,0.5,1.0,1e',
                                 '6.00,0.5,0.5,1.0,1.0,7'])
def test_an_incomplete_row(tmp_path, end):
    path = table(tmp_path / 'x.csv', end=end)
    with pytest.raises(BagError, match='line 302|row 301'):
        read_table(path)
    result = read_table(path, TableOptions(skip_bad_rows=True))
    assert len(result.topic.t) == 300 and result.dropped == 1


def test_milliseconds_read_as_seconds_are_refused(tmp_path):
    path = table(tmp_path / 'x.csv', t=1000 * T)
    with pytest.raises(BagError, match='--time-unit ms, or s if that is right'):
        read_table(path)
    assert read_table(path, TableOptions(time_unit='ms')).topic.t[-1] == pytest.approx(5.98)
    assert read_table(path, TableOptions(time_unit='s')).topic.t[-1] == pytest.approx(5980)
    for unit, size in (('us', 1e6), ('ns', 1e9)):
        with pytest.raises(BagError, match=f'--time-unit {unit}, or s'):
            read_table(table(tmp_path / 'y.csv', t=size * T))


def moving(t, speed=1.0):
    """Return columns of two moving joints: time, positions, velocities, torques."""
    q = np.column_stack([np.sin(speed * t), 0.8 * np.sin(0.8 * speed * t + 1.0)])
    return np.column_stack([t, q, np.gradient(q, t, axis=0), 5 * np.sin(q)])


def with_velocity(path, rows, head='t,q_1,q_2,qd_1,qd_2,tau_1,tau_2'):
    np.savetxt(path, rows, delimiter=',', header=head, comments='')
    return path


def test_a_velocity_shows_the_unit_of_time(tmp_path):
    rows = moving(np.arange(300) * 0.1)
    rows[:, 0] *= 1000
    path = with_velocity(tmp_path / 'x.csv', rows)
    with pytest.raises(BagError, match='998 times the change of the position: give --time-un'):
        read_table(path)
    assert read_table(path, TableOptions(time_unit='ms')).topic.t[-1] == pytest.approx(29.9)


@pytest.mark.parametrize(('columns', 'factor', 'message'), [
    (slice(1, 3), 57.29578, 'is 0.0175 times the change of .*: give --position-unit deg, or'),
    (slice(3, 5), 57.29578, 'is 57.3 times the change of the position: give --velocity none'),
    (slice(3, 5), -1.0, 'is -1 times the change of the position: give --velocity none')])
def test_velocity_inconsistent_with_the_positions(tmp_path, columns, factor, message):
    rows = moving(np.arange(300) * 0.1, 0.2)
    rows[:, columns] *= factor
    path = with_velocity(tmp_path / 'x.csv', rows)
    unit = 'deg' if columns.start == 1 else 'rad'
    with pytest.raises(BagError, match=message):
        read_table(path, TableOptions(position_unit=unit))
    result = read_table(path, TableOptions(position_unit=unit, velocity='none'))
    assert result.topic.velocity is None
    np.testing.assert_allclose(result.topic.position, moving(np.arange(300) * 0.1, 0.2)[:, 1:3],
                               atol=1e-6)


@given(st.floats(0.002, 3.0), st.floats(0.002, 0.49), st.integers(0, 100))
def test_a_table_in_rad_and_s_is_never_refused(speed, step, seed):
    t = np.arange(400) * step
    rows = moving(t, speed)
    noise = np.random.default_rng(seed).normal(size=(400, 4))
    rows[:, 1:5] += noise * [1e-4, 1e-4, 0.02 * speed, 0.02 * speed]
    with tempfile.TemporaryDirectory() as folder:
        path = with_velocity(Path(folder) / 'x.csv', rows)
        assert read_table(path).topic.t[-1] == pytest.approx(t[-1])


@pytest.mark.parametrize('head', [
    '__time,/joint_states/b/position,/joint_states/a/position,/joint_states/b/velocity,'
    '/joint_states/a/velocity,/joint_states/b/effort,/joint_states/a/effort',
    'Time,position_b,position_a,velocity_b,velocity_a,effort_b,effort_a',
    'stamp,b_pos,a_pos,b_vel,a_vel,b_eff,a_eff', 't_s,q_b,q_a,qd_b,qd_a,tau_b,tau_a'])
def test_columns_named_after_joints(tmp_path, head):
    rows = moving(np.arange(100) * 0.1)
    result = read_table(with_velocity(tmp_path / 'x.csv', rows, head)).topic
    assert result.joints == ('b', 'a')
    np.testing.assert_allclose(result.velocity, rows[:, 3:5])
    np.testing.assert_allclose(result.effort, rows[:, 5:])


def test_joints_of_two_topics_are_refused(tmp_path):
    head = 't,/left/a/position,/right/a/position,/left/a/velocity,/right/a/velocity,' \
           '/left/a/effort,/right/a/effort'
    path = with_velocity(tmp_path / 'x.csv', moving(np.arange(100) * 0.1), head)
    with pytest.raises(BagError, match='several topics, /left, /right; name the columns'):
        read_table(path)


def test_dates_as_times_and_unused_text_columns(tmp_path):
    path = tmp_path / 'x.csv'
    lines = [f'2026-01-02T03:04:{s:06.3f}Z,run,{q},{5 * q}' for s, q in
             zip(np.arange(20) * 0.5, np.sin(np.arange(20) * 0.05))]
    path.write_text('time,note,q_1,tau_1\n' + '\n'.join(lines) + '\n')
    result = read_table(path)
    assert result.start_ns == 1767323040 * 10**9
    np.testing.assert_allclose(result.topic.t, np.arange(20) * 0.5, atol=1e-6)
    with pytest.raises(BagError, match="line 2., column note: 'run' is not a number"):
        read_table(path, TableOptions(effort='note'))


def test_a_rate_does_not_replace_a_time_column_silently(tmp_path):
    path = table(tmp_path / 'x.csv')
    with pytest.raises(OptionError, match='has a column of time, t: omit --rate'):
        read_table(path, TableOptions(rate=100.0))
    assert read_table(path, TableOptions(rate=100.0, time='none')).topic.t[-1] == 2.99


@pytest.mark.parametrize('columns', [{'position': '2-3', 'effort': '2-3'},
                                     {'position': '2-3', 'velocity': '3-4', 'effort': '4-5'},
                                     {'time': 'q_1'}])
def test_a_column_used_twice_is_refused(tmp_path, columns):
    with pytest.raises(BagError, match='is used twice'):
        read_table(table(tmp_path / 'x.csv'), TableOptions(**columns))


def same(path, options, other):
    """Check that reading gives the samples of `other`; return the report."""
    whole = read_bag(path, options)
    assert whole.samples.names == other.names
    for what in ('t', 'q', 'qd', 'tau'):
        np.testing.assert_allclose(getattr(whole.samples, what), getattr(other, what), atol=1e-9)
    return whole.report


@pytest.mark.parametrize(('unit', 'size'), [('mNm', 1e-3), ('kgfcm', 0.0980665),
                                            ('lbfft', 1.3558179483314004)])
def test_units_of_effort(tmp_path, unit, size):
    known = read_bag(bag(tmp_path / 'nm.mcap', tau=-TAU)).samples
    path = bag(tmp_path / 'x.mcap', tau=TAU / size)
    report = same(path, ReadOptions(effort_unit=unit, effort_scale={
        'joint_1': -1.0, 'joint_2': -1.0}), known)
    assert report.effort_scale == pytest.approx({'joint_1': -size, 'joint_2': -size})


@pytest.mark.parametrize(('unit', 'share'), [('percent', 1e-2), ('permille', 1e-3)])
def test_shares_of_rated_torques(tmp_path, unit, share):
    known = read_bag(bag(tmp_path / 'nm.mcap')).samples
    path = bag(tmp_path / 'x.mcap', tau=TAU / (share * np.array([20.0, 5.0])))
    rated = {'1': 20.0, 'joint_2': 5.0}
    report = same(path, ReadOptions(effort_unit=unit, rated_torque=rated), known)
    assert report.effort_scale == pytest.approx({'joint_1': 20 * share, 'joint_2': 5 * share})
    with pytest.raises(OptionError, match='the rated torque of joint_2 is missing'):
        read_bag(path, ReadOptions(effort_unit=unit, rated_torque={'1': 20.0}))


def test_numbers_of_joints_are_those_of_the_first_recording(tmp_path):
    paths = [bag(tmp_path / 'x.mcap'), bag(tmp_path / 'y.mcap', Q[:, ::-1], TAU[:, ::-1],
                                           ('joint_2', 'joint_1'))]
    options = ReadOptions(joints=('2', '1'), effort_scale={'1': 4.0}, reverse=('2',),
                          zero={'1': 0.1})
    recording = read_recording(paths, options, None)
    one, other = recording.samples.each_run()
    np.testing.assert_array_equal(one.tau, other.tau)
    np.testing.assert_array_equal(one.q, other.q)
    assert recording.joints == ('joint_2', 'joint_1')
    np.testing.assert_allclose(one.tau, TAU[:, ::-1] * [-1.0, 4.0])
    used = recording.reports[1].options
    assert used.effort_scale == {'joint_1': 4.0} and used.reverse == ('joint_2',)
    # `info` prints the options of the next step.
    assert main(['info', str(paths[0]), '--effort-scale', '1=-1', '--accept', 'effort_sign']) == 0


def test_the_unit_of_one_joint(tmp_path):
    known = read_bag(bag(tmp_path / 'rad.mcap')).samples
    path = bag(tmp_path / 'deg.mcap', Q * [1.0, 180 / np.pi])
    for name in ('joint_2', '2'):
        options = ReadOptions(position_unit={name: 'deg'})
        same(path, options, known)
        assert read_bag(path, options).report.options.position_unit == {'joint_2': 'deg'}
    assert options.words() == ['--position-unit', '2=deg']
    assert main(['info', str(path), '--position-unit', 'joint_2=deg']) == 0
    with pytest.raises(ModelMismatchError, match='no joint wrist'):
        read_bag(path, ReadOptions(position_unit={'wrist': 'deg'}))


def test_a_reversed_joint_has_no_other_scale(tmp_path):
    recording = read_bag(bag(tmp_path / 'x.mcap'), ReadOptions(reverse=('joint_1',)))
    np.testing.assert_array_equal(recording.samples.tau, TAU * [-1.0, 1.0])
    np.testing.assert_array_equal(recording.samples.q, Q * [-1.0, 1.0])
    assert recording.report.effort_scale == {}


def test_renamed_joints(tmp_path):
    known = read_bag(bag(tmp_path / 'x.mcap', names=('shoulder', 'elbow'))).samples
    path = bag(tmp_path / 'y.mcap')
    rename = {'joint_1': 'shoulder', 'joint_2': 'elbow'}
    same(path, ReadOptions(rename=rename), known)
    inverted = ReadOptions(joints=('elbow',), rename=rename, effort_scale={'elbow': -1.0})
    np.testing.assert_array_equal(read_bag(path, inverted).samples.tau[:, 0] < 0, True)
    with pytest.raises(ModelMismatchError, match='no joint wrist .to be renamed.'):
        read_bag(path, ReadOptions(rename={'wrist': 'x'}))
    with pytest.raises(BagError, match='duplicate joint name'):
        read_bag(path, ReadOptions(rename={'joint_1': 'joint_2'}))


def test_the_options_reach_every_reader(tmp_path, capsys):
    path = str(bag(tmp_path / 'x.mcap', q=np.degrees(Q), tau=1000 * TAU))
    options = ['--position-unit', 'deg', '--effort-unit', 'mNm', '--rename', 'joint_1=a,joint_2=b']
    assert main(['info', path, *options]) == 0
    output = capsys.readouterr().out
    assert ' a ' in output and 'degrees?' not in output and '3.50' in output
    assert main(['info', path, '--rename', 'joint_1']) == 2


@pytest.mark.parametrize(('known', 'wanted', 'pairs'), [
    (('r1_j2', 'r1_j1'), ('j1', 'j2'), 'r1_j1=j1,r1_j2=j2'),
    (('j1', 'j2'), ('left/j1', 'left/j2'), 'j1=left/j1,j2=left/j2'),
    (('arm_a_pan', 'arm_a_lift', 'arm_a_gripper'), ('b_lift', 'b_pan'),
     'arm_a_lift=b_lift,arm_a_pan=b_pan'),
    (('arm_pan_joint', 'arm_lift_joint'), ('ur_lift', 'ur_pan'),
     'arm_lift_joint=ur_lift,arm_pan_joint=ur_pan'),
    (('a', 'b'), ('c', 'd'), ''), (('x1', 'x2', 'x12'), ('2', '1'), 'x2=2,x1=1')])
def test_names_of_another_prefix_are_mapped(known, wanted, pairs):
    hint = rename_hint(known, wanted)
    assert hint.endswith(pairs) and bool(hint) == bool(pairs)
