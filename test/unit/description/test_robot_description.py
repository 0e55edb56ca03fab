"""Robot descriptions, and positions of joints without effort, in bags of all formats."""

from bench.shared import urdf_snippets as robots
from bench.shared.recordings import messages, START_NS, STORE, write_folder
from gravity_comp_ros.description.joint_order import (
    AS_RECORDED, DESCRIPTION, joint_order, JointOrder, NAMES)
from gravity_comp_ros.description.robot_tree import find_description
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.bag import (
    decode_string, encode_string, joint_positions, robot_description)
from gravity_comp_ros.recordings.joint_state_cdr import encode, JOINT_STATE
from hypothesis import given, strategies
import numpy as np
import pytest
from rosbags.interfaces import (
    Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime)
from rosbags.rosbag2 import StoragePlugin, Writer

STRING = 'std_msgs/msg/String'
LATCHED = Qos(QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
              QosTime(0, 0), QosTime(0, 0), QosLiveliness.AUTOMATIC, QosTime(0, 0), False)


def string(text: str) -> bytes:
    """Return a std_msgs/String as serialised by rosbags."""
    return bytes(STORE.serialize_cdr(STORE.types[STRING](data=text), STRING))


def write_bag(path, topics, plugin='mcap', qos=()):
    """Write joint states, and topics of strings: name -> list of messages in CDR."""
    storage = StoragePlugin.MCAP if plugin == 'mcap' else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=storage) as writer:
        states = writer.add_connection('/joint_states', JOINT_STATE, typestore=STORE)
        for log_ns, content in messages():
            writer.write(states, log_ns, encode(**content))
        for name, rows in topics.items():
            connection = writer.add_connection(name, STRING, typestore=STORE,
                                               offered_qos_profiles=list(qos))
            for n, raw in enumerate(rows):
                writer.write(connection, START_NS + n, raw)
    return path


@pytest.mark.parametrize('plugin', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('qos', [(), (LATCHED,)], ids=['no qos', 'latched'])
def test_the_description_of_a_bag(tmp_path, plugin, qos):
    text = '<robot name="Ärmchen"/>\n' * 3000
    bag = write_bag(tmp_path / 'run1', {'/robot_description': [string(text)]}, plugin, qos)
    result = robot_description(bag)
    assert result.text == text
    assert result.source == '/robot_description in run1'


def test_the_latest_one_and_the_one_in_a_namespace(tmp_path):
    two = write_bag(tmp_path / 'two', {'/robot_description': [string('old'), string('new')],
                                       '/other/robot_description': [string('other')]})
    assert robot_description(two).text == 'new'
    one = write_bag(tmp_path / 'one', {'/left/robot_description': [string('left')]})
    assert robot_description(one).source == '/left/robot_description in one'
    # Two descriptions in namespaces are ambiguous.
    assert robot_description(write_bag(tmp_path / 'none', {
        '/left/robot_description': [string('l')], '/right/robot_description': [string('r')]})
    ) is None


def test_bags_without_one(tmp_path):
    plain = write_folder(tmp_path / 'plain', {'/joint_states': messages()})
    empty = write_bag(tmp_path / 'empty', {'/robot_description': []})
    full = write_bag(tmp_path / 'full', {'/robot_description': [string('<robot name="a"/>')]})
    assert robot_description(plain) is None and robot_description(empty) is None
    assert find_description(None, [plain, empty]) is None
    assert find_description(None, [plain, full]).source == '/robot_description in full'


def test_a_damaged_description_is_refused(tmp_path):
    bag = write_bag(tmp_path / 'bad', {'/robot_description': [string('<robot/>')[:-4]]})
    with pytest.raises(BagError, match='the text ends after the message'):
        robot_description(bag)
    with pytest.raises(BagError, match='no such recording'):
        robot_description(tmp_path / 'nothing')


@given(strategies.text(alphabet=strategies.characters(exclude_characters='\0',
                                                      exclude_categories=['Cs'])),
       strategies.booleans())
def test_text_in_either_byte_order(text, little):
    raw = STORE.serialize_cdr(STORE.types[STRING](data=text), STRING, little_endian=little)
    assert decode_string(bytes(raw)) == text == decode_string(encode_string(text))
    assert not little or encode_string(text) == bytes(raw)


@given(strategies.binary(max_size=40))
def test_any_bytes_are_text_or_an_error(raw):
    try:
        decode_string(raw)
    except ValueError:
        pass  # UnicodeDecodeError is one


def test_positions_of_joints_without_effort(tmp_path):
    rows = []
    for n in range(20):
        rows.append([START_NS + n, {'stamp_ns': START_NS + n, 'names': ['waist', 'lift'],
                                    'position': [0.3, 0.01 * n], 'effort': []}])
        rows.append([START_NS + n, {'stamp_ns': START_NS + n, 'names': ['elbow'],
                                    'position': [np.nan], 'effort': [1.0]}])
    bag = write_folder(tmp_path / 'bag', {'/joint_states': rows})
    result = joint_positions(bag, ('waist', 'lift', 'elbow', 'absent'))
    assert set(result) == {'waist', 'lift'}
    assert set(result['waist']) == {0.3} and np.ptp(result['lift']) == pytest.approx(0.19)


def test_a_description_orders_joints():
    assert joint_order(sorted(robots.UR_JOINTS), robots.UR) == joint_order(
        robots.UR_JOINTS, robots.UR)
    assert joint_order(sorted(robots.UR_JOINTS), robots.UR.encode()) == JointOrder(
        robots.UR_JOINTS, DESCRIPTION)


ANY = ('tilt', 'swing', 'reach')


@pytest.mark.parametrize('urdf', ['<robot', robots.PANDA, None])
def test_an_unusable_description_is_ignored(urdf):
    assert joint_order(ANY, urdf) == JointOrder(ANY, AS_RECORDED)


@pytest.mark.parametrize('names', [
    [f'iiwa_joint_{n}' for n in range(1, 8)], [f'joint_a{n}' for n in range(1, 8)],
    [f'panda_joint{n}' for n in range(1, 8)], [f'arm_{n}_joint' for n in range(1, 8)],
    [f'joint_{n}' for n in range(1, 13)], [f'lbr7_A{n}' for n in range(7)],
    [f'left_{part}' for part in robots.BAXTER_PARTS], ['S0', 'S1', 'E0', 'E1', 'W0'],
])
@given(data=strategies.data())
def test_numbers_in_the_names(names, data):
    shuffled = data.draw(strategies.permutations(names))
    assert joint_order(shuffled) == JointOrder(tuple(names), NAMES)


FETCH = ('shoulder_pan_joint', 'shoulder_lift_joint', 'upperarm_roll_joint', 'elbow_flex_joint',
         'forearm_roll_joint', 'wrist_flex_joint', 'wrist_roll_joint')


@pytest.mark.parametrize('names', [
    robots.UR_JOINTS, [f'left_{name}' for name in robots.UR_JOINTS], FETCH,
    ['r_shoulder_pan', 'r_shoulder_lift', 'r_upper_arm_roll', 'r_elbow_flex', 'r_wrist_flex'],
    ['waist', 'shoulder', 'elbow', 'forearm_roll', 'wrist_angle', 'wrist_rotate'],
    ['Waist', 'Shoulder', 'Elbow', 'WristAngle', 'WristRotate'],
])
@given(data=strategies.data())
def test_words_in_the_names(names, data):
    shuffled = data.draw(strategies.permutations(list(names)))
    assert joint_order(shuffled) == JointOrder(tuple(names), NAMES)


@pytest.mark.parametrize('names', [
    ['tilt', 'swing'], ['a'], ['left_elbow', 'right_elbow', 'left_wrist', 'right_wrist'],
    ['shoulder_pitch', 'shoulder_roll', 'shoulder_yaw', 'elbow'], ['elbow', 'Elbow', 'wrist'],
    # Two arms, or other joints besides those of the arm: the numbers define no order.
    ['left_1', 'left_2', 'right_1', 'right_2'],
    ['arm1_joint1', 'arm1_joint2', 'arm2_joint1', 'arm2_joint2'],
    ['joint_2', 'joint_1', 'gripper'], ['joint_01', 'joint_1'],
])
def test_ambiguous_names_stay_as_recorded(names):
    assert joint_order(names) == JointOrder(tuple(names), AS_RECORDED)


@given(strategies.lists(strategies.text(max_size=8), max_size=6, unique=True))
def test_an_order_is_a_stable_permutation(names):
    order = joint_order(names)
    assert sorted(order.joints) == sorted(names)
    assert joint_order(order.joints).joints == order.joints
