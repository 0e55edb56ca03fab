"""Damaged files and files of other formats: refused in one line, or read with a note."""

import shutil
import sqlite3

from bench.shared.recordings import add_other_topic, messages, motion, NAMES, write_folder
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.recordings import mcap_writer
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
import numpy as np
import pytest

T, Q, QD, TAU = motion()


@pytest.fixture
def mcap(tmp_path, monkeypatch):
    path = tmp_path / 'x.mcap'
    monkeypatch.setattr(mcap_writer, '_CHUNK_BYTES', 2000)
    write_bag(path, [JointTopic('/joint_states', NAMES, T, Q, QD, TAU)])
    return path


@pytest.fixture
def db3(tmp_path):
    (file,) = write_folder(tmp_path / 'bag', {'/joint_states': messages()}).glob('*.db3')
    return file


def refusal(path, options=None):
    with pytest.raises(GravityCompError) as error:
        read_bag(path, options or ReadOptions())
    text = str(error.value)
    assert '\n' not in text and path.name in text
    return text


def test_truncated_mcap_reports_the_readable_messages(mcap):
    whole = mcap.read_bytes()
    mcap.write_bytes(whole[:len(whole) * 2 // 3])
    text = refusal(mcap)
    assert 'truncated' in text
    count = int(text.split('its first ')[1].split()[0])
    assert 10 < count < 50
    mcap.write_bytes(whole[:60])
    assert 'no message in it can be read' in refusal(mcap)


def test_mcap_cut_anywhere_is_refused(mcap):
    whole = mcap.read_bytes()
    for length in [*range(40), *range(40, len(whole), 301), *range(len(whole) - 40, len(whole))]:
        mcap.write_bytes(whole[:length])
        refusal(mcap)


def test_a_wrong_summary_is_refused(mcap):
    whole = bytearray(mcap.read_bytes())
    place = whole.rindex(b'/joint_states')
    whole[place:place + 13] = b'/other_states'
    mcap.write_bytes(whole)
    assert 'checksum of its summary' in refusal(mcap)


def test_truncated_db3(db3):
    whole = db3.read_bytes()
    for part in (0.01, 0.1):
        db3.write_bytes(whole[:int(part * len(whole))])
        assert 'cannot be read' in refusal(db3) or 'no usable' in refusal(db3)


@pytest.mark.parametrize('has_index', [False, True])
def test_the_rest_of_a_damaged_db3_is_read(tmp_path, has_index):
    # A page contains two dozen messages; recorders of ROS add an index of their times.
    (file,) = write_folder(tmp_path / 'bag', {'/joint_states': messages(1000)}).glob('*.db3')
    base = sqlite3.connect(file)
    base.execute('DROP INDEX IF EXISTS timestamp_idx')
    if has_index:
        base.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
    base.commit()
    base.execute('VACUUM')
    base.close()
    whole, page = file.read_bytes(), 4096
    q = motion(1000)[1]

    def check(data, least, most):
        file.write_bytes(data)
        recording = read_bag(file)
        assert least <= len(recording.samples) < most
        times = np.rint(50.0 * (recording.samples.t + 1e-9 * recording.report.start_ns
                                - 1_700_000_000)).astype(int)
        np.testing.assert_allclose(recording.samples.q, q[times])
        assert 'readable messages of /joint_states are used' in recording.report.file_notes[0]

    damaged, count = bytearray(whole), len(whole) // page
    for number in (count // 4, 3 * count // 4):
        damaged[number * page:(number + 1) * page] = b'\xa5' * page
    check(damaged, 940, 1000)
    check(whole[:(count * 6 // 10) * page], 500, 700)


def test_a_db3_without_its_schema_names_a_tool(db3):
    whole = bytearray(db3.read_bytes())
    whole[100:4096] = b'\xff' * 3996
    db3.write_bytes(whole)
    assert f'`sqlite3 {db3} .recover`' in refusal(db3)


def test_flipped_bytes_of_a_db3_never_crash(db3):
    whole = db3.read_bytes()
    rng = np.random.default_rng(0)
    for place in rng.integers(16, len(whole), 60):
        damaged = bytearray(whole)
        damaged[place] ^= 255
        db3.write_bytes(damaged)
        try:
            read_bag(db3)
        except GravityCompError as error:
            assert '\n' not in str(error)


def test_invalid_rows_of_a_db3(db3):
    base = sqlite3.connect(db3)
    base.execute("UPDATE messages SET data = 'text' WHERE id = 3")
    base.execute('UPDATE messages SET data = 3.5 WHERE id = 4')
    base.commit()
    base.close()
    assert dict(read_bag(db3).report.dropped) == {'not decodable': 2}


def test_a_database_without_recording(tmp_path):
    path = tmp_path / 'x.db3'
    base = sqlite3.connect(path)
    base.execute('CREATE TABLE songs (name TEXT)')
    base.commit()
    base.close()
    assert 'not a recording' in refusal(path)


@pytest.mark.parametrize(('content', 'message'), [
    (b'', 'empty'), (b'hello', 'neither an MCAP nor'), (b'#ROSBAG V2.0\n', 'ROS 1'),
    (b'\x28\xb5\x2f\xfd junk', 'cannot be decompressed'),
    (b'\x89MCAP0\r\n', 'truncated'), (b'SQLite format 3\0' + bytes(200), 'cannot be read')])
def test_not_a_recording(tmp_path, content, message):
    path = tmp_path / 'x.mcap'
    path.write_bytes(content)
    assert message in refusal(path)


def test_missing_recordings(tmp_path):
    assert 'no such recording' in refusal(tmp_path / 'none.mcap')
    (tmp_path / 'folder').mkdir()
    assert 'neither metadata.yaml nor' in refusal(tmp_path / 'folder')
    for name in ('morning', 'evening'):
        (source,) = write_folder(tmp_path / name, {'/joint_states': messages()}).glob('*.db3')
        shutil.copy(source, tmp_path / 'folder' / f'{name}_0.db3')
    assert 'name one of evening_0.db3, morning_0.db3' in refusal(tmp_path / 'folder')


def test_recordings_without_joint_states(tmp_path):
    path = add_other_topic(tmp_path / 'chat')
    assert 'it has /chatter (std_msgs/msg/String)' in refusal(path)
    text = refusal(path, ReadOptions(topic='/chatter'))
    assert 'topic /chatter is a std_msgs/msg/String' in text


def test_empty_recordings(tmp_path):
    assert 'empty: it has no topics' in refusal(write_folder(tmp_path / 'bag', {}))
    path = tmp_path / 'x.mcap'
    write_bag(path, [])
    assert 'empty: it has no topics' in refusal(path)
    nothing = np.empty((0, 3))
    write_bag(path, [JointTopic('/joint_states', NAMES, np.empty(0), nothing, nothing, nothing)])
    assert 'has no messages' in refusal(path)


def test_metadata_that_names_a_missing_file(tmp_path):
    folder = write_folder(tmp_path / 'bag', {'/joint_states': messages()})
    (file,) = folder.glob('*.db3')
    file.rename(folder / 'renamed.db3')
    text = refusal(folder)
    assert file.name in text and 'there is renamed.db3' in text
    (folder / 'renamed.db3').unlink()
    assert file.name in refusal(folder)


@pytest.mark.parametrize('content', [
    'hello', '', '[1, 2', 'rosbag2_bagfile_information: {}', '\0',
    'rosbag2_bagfile_information: {relative_file_paths: [1]}',
    'rosbag2_bagfile_information: {relative_file_paths: []}',
    '!!python/object/apply:os.system ["true"]'])
def test_broken_metadata(tmp_path, content):
    folder = write_folder(tmp_path / 'bag', {'/joint_states': messages()})
    (folder / 'metadata.yaml').write_text(content)
    assert 'metadata' in refusal(folder)


def test_metadata_cannot_reach_outside_its_folder(tmp_path):
    folder = write_folder(tmp_path / 'bag', {'/joint_states': messages()})
    (file,) = folder.glob('*.db3')
    file.rename(tmp_path / 'secret.db3')
    text = (folder / 'metadata.yaml').read_text().replace(file.name, '../secret.db3')
    (folder / 'metadata.yaml').write_text(text)
    assert 'secret.db3' in refusal(folder)
