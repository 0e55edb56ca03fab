"""Reading of recordings in all formats, and handling of defects in them."""

import re
import shutil

from bench.shared.recordings import check_motion, messages, motion, NAMES, START_NS, write_folder
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.errors import BagError, ModelMismatchError
from gravity_comp_ros.facts.fact import Action
from gravity_comp_ros.recordings import cleaning, joint_columns
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import joint_states, JointTopic, write_bag
from hypothesis import given, strategies as st
import numpy as np
import pytest

T, Q, QD, TAU = motion()


def recorded(tmp_path, rows):
    """Write these messages as a recording of /joint_states; return its path."""
    return write_folder(tmp_path / 'bag', {'/joint_states': rows})


def check_is_the_motion(recording):
    check_motion(recording)
    report = recording.report
    assert (report.n_messages, report.n_samples, dict(report.dropped)) == (50, 50, {})
    assert report.velocity == 'measured'
    assert report.rate_hz == pytest.approx(50)
    assert report.duration_s == pytest.approx(0.98)
    assert report.start_ns == START_NS
    assert len(report.sha256) == 64


@pytest.mark.parametrize('version', [8, 9])
@pytest.mark.parametrize('plugin', ['sqlite3', 'mcap'])
@pytest.mark.parametrize('compression', [None, 'MESSAGE', 'FILE', 'STORAGE'])
def test_rosbag2_folders(tmp_path, plugin, version, compression):
    if compression == 'STORAGE' and plugin == 'sqlite3':
        compression = None  # only mcap has storage compression
    path = write_folder(tmp_path / 'bag', {'/joint_states': messages()}, plugin, version,
                        compression)
    check_is_the_motion(read_bag(path))


def test_bare_db3_without_metadata_and_folder_without_metadata(tmp_path):
    folder = recorded(tmp_path, messages())
    (folder / 'metadata.yaml').unlink()
    (file,) = folder.iterdir()
    check_is_the_motion(read_bag(file))
    recording = read_bag(folder)
    check_is_the_motion(recording)
    assert recording.report.sha256 == read_bag(file).report.sha256


def test_reading_leaves_a_db3_and_its_folder_untouched(tmp_path):
    folder = recorded(tmp_path, messages())
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    folder.chmod(0o555)
    read_bag(folder)
    folder.chmod(0o755)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_recording_split_into_files_in_natural_order(tmp_path):
    rows = messages()
    folder = tmp_path / 'split'
    folder.mkdir()
    for name, part in (('x_2', rows[:20]), ('x_10', rows[20:])):
        (source,) = write_folder(tmp_path / name, {'/joint_states': part}).glob('*.db3')
        shutil.copy(source, folder / f'{name}.db3')
    check_is_the_motion(read_bag(folder))


@given(st.data())
def test_written_samples_are_read_back(tmp_path_factory, data):
    n = data.draw(st.integers(1, 10))
    m = data.draw(st.integers(1, 20))
    # Words such as `linear` and `finger` name joints that are left out.
    names = data.draw(st.lists(st.text(st.characters(codec='utf-8', exclude_characters='\0'),
                                       min_size=1, max_size=12).filter(
                                           lambda name: not re.search('[a-zA-Z]', name)),
                               min_size=n, max_size=n, unique=True))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    t = np.cumsum(rng.integers(1, 10**9, m)) / 1e9
    q, qd, tau = rng.standard_normal((3, m, n)) * 10.0 ** rng.integers(-300, 8)
    samples = JointSamples.single_run(names, t, q, qd, tau)
    path = tmp_path_factory.mktemp('x') / 'x.mcap'
    write_bag(path, [joint_states(samples)])
    # A few efforts near 1e-300 would be refused as dead.
    result = read_bag(path, ReadOptions(refuse=False)).samples
    assert result.names == samples.names
    np.testing.assert_allclose(result.t, t - t[0], atol=1.1e-9)
    for field in ('q', 'qd', 'tau'):
        np.testing.assert_array_equal(getattr(result, field), getattr(samples, field))


def test_joints_are_matched_by_name_in_every_message(tmp_path):
    rows = messages()
    rng = np.random.default_rng(0)
    for _, content in rows[1:]:
        order = rng.permutation(3)
        for field in ('names', 'position', 'velocity', 'effort'):
            content[field] = [content[field][k] for k in order]
    check_is_the_motion(read_bag(recorded(tmp_path, rows)))


def test_chosen_joints_and_effort_scale(tmp_path):
    path = recorded(tmp_path, messages())
    options = ReadOptions(joints=('wrist', 'shoulder'), effort_scale={'wrist': -2.0, 'elbow': 9})
    samples = read_bag(path, options).samples
    assert samples.names == ('wrist', 'shoulder')
    np.testing.assert_array_equal(samples.q, Q[:, [2, 0]])
    np.testing.assert_array_equal(samples.tau, TAU[:, [2, 0]] * [-2, 1])


NAN, INF = float('nan'), float('inf')
# New values of the fields of a message.
SPOILT = {
    'NaN effort': {'effort': lambda x: [x[0], NAN, x[2]]},
    'infinite position': {'position': lambda x: [*x[:2], -INF]},
    'NaN velocity': {'velocity': lambda x: [NAN, *x[1:]]}, 'no effort': {'effort': lambda x: []},
    'short velocity': {'velocity': lambda x: x[:2]},
    'one name twice': {'names': lambda x: ['shoulder', 'shoulder', 'wrist']},
    'time back': {'stamp_ns': lambda x: x - 10**9},
    'time repeated': {'stamp_ns': lambda x: x - 20_000_000},
    'one joint less': dict.fromkeys(('names', 'position', 'velocity', 'effort'), lambda x: x[:2]),
    'other joints': {'names': lambda x: ['lamp'], 'position': lambda x: [1.0],
                     'velocity': lambda x: [0.0], 'effort': lambda x: [0.5]},
    'zero effort': {'effort': lambda x: [0.0, 0.0, 0.0]}}


def spoil(rows, kind):
    """Change messages; `kind` is a key of `SPOILT`, or 'rubbish'."""
    for row in rows:
        if kind == 'rubbish':
            row[1] = b'\0\1\0\0rubbish'
        else:
            row[1].update({field: new(row[1][field]) for field, new in SPOILT[kind].items()})


@pytest.mark.parametrize(('kind', 'reason'), [
    ('NaN effort', cleaning.NOT_FINITE), ('infinite position', cleaning.NOT_FINITE),
    ('NaN velocity', cleaning.VELOCITY), ('no effort', cleaning.NOT_FINITE),
    ('short velocity', 'with 2 values of velocity for 3 joints'),
    ('one name twice', 'duplicate joint name shoulder'), ('time back', cleaning.TIME),
    ('time repeated', cleaning.TIME), ('rubbish', joint_columns.UNDECODABLE),
    ('one joint less', cleaning.MISSING), ('other joints', cleaning.OTHER_JOINTS)])
def test_bad_messages_are_dropped_and_counted(tmp_path, kind, reason):
    rows = messages()
    bad = [7, 20, 30]
    spoil([rows[number] for number in bad], kind)
    recording = read_bag(recorded(tmp_path, rows), ReadOptions(joints=NAMES))
    assert dict(recording.report.dropped) == {reason: 3}
    assert (recording.report.n_messages, recording.report.n_samples) == (50, 47)
    np.testing.assert_array_equal(recording.samples.q, np.delete(Q, bad, axis=0))
    np.testing.assert_allclose(recording.samples.t, np.delete(T, bad), atol=1e-9)


@pytest.mark.parametrize('first', [[40], [150], [40, 80, 120, 160]])
def test_messages_after_a_clock_is_set_back_are_left_out_until_it_has_caught_up(tmp_path, first):
    rows, late = messages(200), np.zeros(200, dtype=bool)
    for number in first:
        late[number:number + 4] = True
        for row in rows[number:]:
            row[1]['stamp_ns'] -= 80_000_000
    stamps = np.array([row[1]['stamp_ns'] for row in rows])
    # The clock of the driver, and that of the recorder too.
    both = [(row[1]['stamp_ns'], *row[1:]) for row in rows]
    for each in (recorded(tmp_path, rows), *([] if len(first) > 3 else [
            recorded(tmp_path / 'both', both),
            write_folder(tmp_path / 'mcap', {'/joint_states': both}, 'mcap')])):
        recording = read_bag(each)
        np.testing.assert_allclose(recording.samples.t, (stamps[~late] - START_NS) / 1e9,
                                   atol=1e-9)
        np.testing.assert_array_equal(recording.samples.q, motion(200)[1][~late])
        assert recording.report.dropped == {cleaning.TIME: 4 * len(first)}
        (note,) = recording.report.file_notes
        assert 'the clock goes back by 0.06 s' in note and f'{4 * len(first)} messages' in note
        assert f'after {(first[0] - 1) / 50:.4g} s' in note


def test_a_clock_that_never_catches_up_is_named_with_the_loss(tmp_path):
    rows = messages(200)
    both = [(row[0] - 10**13 * (number >= 50), {
        **row[1], 'stamp_ns': row[0] - 10**13 * (number >= 50)})
        for number, row in enumerate(rows)]
    report = read_bag(recorded(tmp_path, both)).report
    assert report.dropped == {cleaning.TIME: 150} and report.n_samples == 50
    (note,) = report.file_notes
    assert 'goes back by 1e+04 s' in note and '150 messages' in note


def test_stamps_that_go_back_in_a_loop_are_replaced(tmp_path):
    rows = messages(200)
    for number, row in enumerate(rows):
        row[1]['stamp_ns'] = rows[number % 20][0]
    again = read_bag(recorded(tmp_path / 'loop', rows))
    assert len(again.samples) == 200 and 'time of recording' in again.report.file_notes[0]


def test_a_joint_that_drops_out_is_named(tmp_path):
    rows = messages(100)
    spoil(rows[70:], 'one joint less')
    recording = read_bag(recorded(tmp_path, rows), ReadOptions(joints=NAMES))
    assert len(recording.samples) == 70
    (note,) = recording.report.file_notes
    assert 'is missing from 30 messages, between 1.4 and 1.98 s' in note


@pytest.mark.parametrize(('kind', 'step', 'message'), [
    ('zero effort', 1, 'effort is 0 throughout'),
    ('no effort', 1, 'effort of every joint is missing, NaN or beyond 1e.09 in 50 of 50 '
                     'messages; the driver must publish it'),
    ('NaN effort', 1, 'effort of joint elbow is missing, NaN or beyond 1e.09 in 50 of 50.*'
                      '--joints shoulder,wrist'),
    ('infinite position', 1, 'position of joint wrist .*--joints shoulder,elbow'),
    ('one joint less', 2, 'joint wrist is missing from 25 of 50 messages.*'
                          '--joints shoulder,elbow'),
    ('short velocity', 1, 'no usable message: 50 with 2 values of velocity for 3 joints'),
    ('one name twice', 1, 'no usable message: 50 duplicate joint name'),
    ('rubbish', 1, 'no usable message: 50 not decodable'), ('none', 1, 'has no messages')])
def test_defect_of_half_the_recording_is_an_error_in_one_line(tmp_path, kind, step, message):
    rows = messages() if kind != 'none' else []
    spoil(rows[::step], kind)
    path = recorded(tmp_path, rows)
    with pytest.raises(BagError, match=message) as error:
        read_bag(path)
    assert str(path) in str(error.value) and '\n' not in str(error.value)


def test_joints_of_two_publishers_on_one_topic_can_be_selected(tmp_path):
    rows = messages(100)
    spoil(rows[1::2], 'other joints')
    path = recorded(tmp_path, rows)
    with pytest.raises(BagError, match='missing from 50 of 100.*--joints'):
        read_bag(path)
    recording = read_bag(path, ReadOptions(joints=NAMES))
    assert dict(recording.report.dropped) == {cleaning.OTHER_JOINTS: 50}
    assert recording.report.rate_hz == pytest.approx(25)


@pytest.mark.parametrize('option', [{'joints': ('elbow', 'knee')}, {'effort_scale': {'knee': 2}}])
def test_unknown_joint(tmp_path, option):
    path = recorded(tmp_path, messages())
    with pytest.raises(ModelMismatchError, match='no joint knee .*shoulder, elbow, wrist'):
        read_bag(path, ReadOptions(**option))


@pytest.mark.parametrize('stamp', ['unset', 'same', 'backwards', 'one from the future'])
def test_log_time_replaces_bad_stamps(tmp_path, stamp):
    rows = messages()
    for number, (log_ns, content) in enumerate(rows):
        content['stamp_ns'] = {'unset': 0, 'same': START_NS, 'backwards': START_NS - number,
                               'one from the future': log_ns + (number == 3) * 10**15}[stamp]
    recording = read_bag(recorded(tmp_path, rows))
    np.testing.assert_allclose(recording.samples.t, T, atol=1e-9)
    assert any('time of recording' in note for note in recording.report.notes)


@pytest.mark.parametrize('is_simulated', [False, True])
def test_stamps_take_precedence_over_a_jittering_log_time(tmp_path, is_simulated):
    """Also those of a simulated clock, which begins at 0."""
    rows = messages()
    rng = np.random.default_rng(1)
    for row in rows:
        row[0] += int(rng.integers(0, 15_000_000))
        row[1]['stamp_ns'] -= START_NS * is_simulated
    recording = read_bag(recorded(tmp_path, rows))
    np.testing.assert_allclose(recording.samples.t, T, atol=1e-9)
    assert recording.report.start_ns == START_NS * (not is_simulated)
    assert recording.report.notes == ()


@pytest.mark.parametrize(('value', 'joints', 'evidence'), [
    ('none', NAMES, 'is not recorded'), (NAN, ('elbow',), 'is not recorded'),
    (0.0, ('elbow',), 'is 0 throughout')])
def test_velocities_that_are_not_measured_are_differentiated(tmp_path, value, joints, evidence):
    rows, (_, _, qd, _) = messages(200), motion(200)
    for row in rows:
        if value == 'none':
            row[1]['velocity'] = []
        else:
            row[1]['velocity'][1] = value
    recording = read_bag(recorded(tmp_path, rows))
    (fact,) = recording.report.facts
    assert fact.joints == joints and fact.action is Action.CORRECTED
    assert evidence in fact.evidence and recording.report.velocity == 'differentiated'
    np.testing.assert_allclose(recording.samples.qd, qd, atol=2e-3)
    measured = [name not in joints for name in NAMES]
    np.testing.assert_array_equal(recording.samples.qd[:, measured], qd[:, measured])


def test_velocity_0_of_a_joint_at_rest_is_no_fact(tmp_path):
    rows = messages(200)
    for row in rows:
        row[1]['velocity'][1], row[1]['position'][1] = 0.0, 0.4
    assert read_bag(recorded(tmp_path, rows)).report.facts == ()


@pytest.mark.parametrize('isolated', [0, 50])
def test_an_isolated_sample_is_dropped(tmp_path, isolated):
    rows = messages(100)
    for number, row in enumerate(rows):
        row[1]['velocity'] = []
        row[1]['stamp_ns'] += 10**10 * ((number >= isolated) + (number > isolated))
    recording = read_bag(recorded(tmp_path, rows))
    assert dict(recording.report.dropped) == {cleaning.ISOLATED: 1}
    assert len(recording.samples) == 99
    # The start is that of the first sample.
    first = rows[isolated == 0][1]['stamp_ns']
    assert recording.report.start_ns == first
    assert recording.samples.starts[0] == pytest.approx(first / 1e9, abs=1e-6)


def topic(name, effort=TAU):
    return JointTopic(name, NAMES, T, Q, QD, effort)


def test_choice_of_the_topic(tmp_path):
    path = tmp_path / 'x.mcap'
    write_bag(path, [topic('/other', 2 * TAU), topic('/joint_states')])
    recording = read_bag(path)
    assert recording.report.topic == '/joint_states'
    assert recording.report.notes == ('JointState topics not read: /other',)
    np.testing.assert_array_equal(recording.samples.tau, TAU)
    for name in ('/other', 'other'):
        other = read_bag(path, ReadOptions(topic=name))
        np.testing.assert_array_equal(other.samples.tau, 2 * TAU)
    with pytest.raises(BagError, match='no topic /none; its JointState topics are /other, /joi'):
        read_bag(path, ReadOptions(topic='/none'))


def test_ambiguous_topics_are_refused(tmp_path):
    path = tmp_path / 'x.mcap'
    write_bag(path, [topic('/left/joint_states'), topic('/right/joint_states')])
    with pytest.raises(BagError, match='/left/joint_states, /right/joint_states; choose'):
        read_bag(path)
    empty = JointTopic('/left/joint_states', NAMES, np.empty(0), np.empty((0, 3)))
    write_bag(path, [empty, topic('/right/joint_states')])
    assert read_bag(path).report.topic == '/right/joint_states'


@pytest.mark.parametrize('plugin', ['sqlite3', 'mcap'])
def test_many_messages_are_subsampled_evenly(tmp_path, plugin):
    # The messages of a gripper alternate with those of the arm.
    rows = []
    for row in messages(600):
        gripper = [row[0] + 1, {**row[1], 'stamp_ns': row[0] + 1, 'names': ['gripper'],
                                'position': [1.0], 'velocity': [0.0], 'effort': [0.0]}]
        rows += [row, gripper]
    path = write_folder(tmp_path / 'bag', {'/joint_states': rows}, plugin)
    whole = read_bag(path, ReadOptions(joints=NAMES)).samples
    recording = read_bag(path, ReadOptions(joints=NAMES, max_messages=600))
    samples = recording.samples
    assert abs(len(samples) - 300) <= 2 and len(whole) == 600
    assert '50% of 1200 messages are used' in ' '.join(recording.report.notes)
    kept = np.searchsorted(whole.t + 1e-9, samples.t + whole.t[0])
    assert np.diff(kept).max() <= 4
    assert read_bag(path, ReadOptions(joints=NAMES, max_messages=1200)).report.notes == ()
