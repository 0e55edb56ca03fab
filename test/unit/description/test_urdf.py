"""Joint axes from a URDF, against Pinocchio."""

from pathlib import Path

from bench.shared import urdf_snippets as robots
from bench.shared.serial_arms import poses
from gravity_comp_ros.description.links import described_arm, DescribedArm, frame_parameters
from gravity_comp_ros.description.robot_tree import parse_tree
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
from gravity_comp_ros.models.codec import decode, encode
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.simulation import arms
from hypothesis import given, strategies
import numpy as np
import pytest

IIWA = Path(__file__).resolve().parents[3] / 'bags' / 'iiwa7.urdf'

# A tilted pedestal, axes in any direction, fixed joints between them, a gripper, and a joint
# element of a transmission.
TILTED = """<robot name="bent">
  <link name="world"/>
  <joint name="pedestal" type="fixed"><parent link="world"/><child link="base"/>
    <origin xyz="0 0 1" rpy="0.3 -0.2 1"/></joint>
  <link name="base"/>
  <joint name="a" type="continuous"><parent link="base"/><child link="one"/>
    <origin xyz="0.1 0 0.2" rpy="0 0.4 0"/><axis xyz="0 1 0"/></joint>
  <link name="one"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bracket" type="fixed"><parent link="one"/><child link="mount"/>
    <origin xyz="0 0 0.3" rpy="0.1 0.2 0.3"/></joint>
  <link name="mount"/>
  <joint name="b" type="revolute"><parent link="mount"/><child link="two"/>
    <origin xyz="0 0.2 0"/><axis xyz="0 0 -2"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="two"><inertial><origin xyz="0.2 -0.1 0.1"/><mass value="1.5"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="c" type="revolute"><parent link="two"/><child link="hand"/>
    <origin xyz="0.3 0 0" rpy="0 0 2"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <link name="hand"><inertial><origin xyz="0 0.1 0.1"/><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="finger" type="prismatic"><parent link="hand"/><child link="tip"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <link name="tip"/>
  <transmission name="t"><joint name="a"/></transmission>
</robot>"""


def test_the_urdf_matches_the_simulated_arm():
    arm, again = arms.iiwa7(), arms.from_urdf(IIWA)
    q = poses(20, 7)
    np.testing.assert_allclose(arms.gravity_torque(again, q), arms.gravity_torque(arm, q),
                               atol=1e-6)
    np.testing.assert_allclose(again.upper, arm.upper, atol=1e-8)
    assert again.joints == arm.joints


def test_joints_are_in_the_order_of_the_arm():
    geometry = described_arm(TILTED, ('c', 'a', 'b')).geometry
    assert geometry.joints == ('a', 'b', 'c') and geometry.link == 'hand'
    # The first joints of an arm are an arm.
    assert described_arm(TILTED, ('b', 'a')).geometry.link == 'two'


@pytest.mark.parametrize('text, joints, error, message', [
    (TILTED, ('a', 'x'), ModelMismatchError, 'has no joint x; it has a, b, c, finger'),
    (TILTED, ('a', 'b', 'c', 'finger'), ModelMismatchError, 'finger is prismatic'),
    (TILTED.replace('<parent link="two"/>', '<parent link="base"/>'),
     ('a', 'b', 'c'), ModelMismatchError, 'different branches'),
    ('<robot', ('a',), DataError, 'not a URDF'),
    (b'\xff\xfe\x00<robot>', ('a',), DataError, 'not a URDF'),
    # Entities, which may grow without bound or be another file.
    ('<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;"/>', ('a',),
     DataError, 'not a URDF'),
    ('<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>', ('a',),
     DataError, 'not a URDF'),
    ('<sdf/>', ('a',), DataError, '<sdf>'),
    ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arg name="x"/></robot>', ('a',),
     DataError, 'xacro'),
    (TILTED.replace('xyz="0.1 0 0.2"', 'xyz="${reach} 0 0"'), ('a',), DataError, 'xacro'),
    (TILTED.replace('</robot>', '<link name="arm"><inertial><mass value="${m}"/></inertial></link>'
                    '</robot>'), ('a',), DataError, 'is a xacro file'),
    (TILTED.replace('xyz="0 0.2 0"', 'xyz="0 200 0"'), ('a', 'b', 'c'), DataError,
     'joint b is 200 m from the frame before it: is the description in mm?'),
    ('<robot><joint name="a" type="revolute"/></robot>', ('a',), DataError, 'no parent'),
    (TILTED.replace('name="c"', 'name="a"'), ('a',), DataError, 'two joints are named a'),
    (TILTED.replace('<child link="tip"/>', '<child link="two"/>'), ('a',), DataError,
     'link two has two parents'),
    (TILTED.replace('type="continuous"', 'type="ball"'), ('b',), DataError, 'type "ball"'),
    (TILTED.replace('xyz="0 0 -2"', 'xyz="0 0 nan"'), ('a', 'b'), DataError, 'not 3 numbers'),
    (TILTED.replace('xyz="0 0 -2"', 'xyz="0 0"'), ('a', 'b'), DataError, 'not 3 numbers'),
    (TILTED.replace('xyz="0 0 -2"', 'xyz="0 0 0"'), ('a', 'b'), DataError, 'no direction'),
    (TILTED.replace('<parent link="world"/>', '<parent link="one"/>'), ('a',), DataError,
     'among its own parents'),
])
def test_invalid_descriptions_are_refused(text, joints, error, message):
    with pytest.raises(error, match=message) as caught:
        described_arm(text, joints, 'arm.urdf')
    assert '\n' not in str(caught.value)


def test_geometry_is_checked():
    eye = np.eye(3)
    with pytest.raises(DataError, match='rotations'):
        Geometry(('a', 'b'), eye[None], np.zeros((2, 3)), 'l', eye)
    with pytest.raises(DataError, match='not finite'):
        Geometry(('a',), eye[None], np.full((1, 3), np.nan), 'l', eye)
    with pytest.raises(DataError, match='not given by a rotation'):
        Geometry(('a',), 2.0 * eye[None], np.zeros((1, 3)), 'l', eye)


def test_the_geometry_has_the_inertials_of_links_that_are_possible():
    # Inertias of 1 kg·m^2 of 1 kg at the hand: a radius of gyration of 1 m, beyond its reach.
    slim = TILTED.replace('ixx="1" iyy="1" izz="1"', 'ixx="0.01" iyy="0.01" izz="0.01"')
    joints = ('a', 'b', 'c')
    arm = described_arm(slim, joints)
    np.testing.assert_allclose(arm.geometry.inertials, frame_parameters(arm, arm.inertials()))
    np.testing.assert_allclose(arm.geometry.inertials[:, 0], [2.0, 1.5, 1.0])
    again = decode(Geometry, encode(arm.geometry))
    np.testing.assert_array_equal(again.inertials, arm.geometry.inertials)

    wrong = slim.replace('mass value="1.5"', 'mass value="heavy"')
    assert not described_arm(wrong, joints).geometry.inertials.any()
    for old, new in (('mass value="1.5"', 'mass value="0"'), ('ixx="0.01"', 'ixx="1"'),
                     ('xyz="0.2 -0.1 0.1"', 'xyz="200 -100 100"'),
                     ('ixx="0.01" iyy="0.01"', 'ixx="0.01" iyy="-0.01"')):
        text = slim.replace(old, new)
        masses = described_arm(text, joints).geometry.inertials[:, 0]
        assert masses[1] == 0.0
        # Each fault is that of the links whose numbers changed, and the others are kept.
        assert (masses > 0.0).sum() == 3 - sum(
            (a != b) for a, b in zip(slim.split('</inertial>'), text.split('</inertial>')))


MASS, COM = 2.0, np.array([0.03, -0.05, 0.12])


def check_axes(text: str, geometry: Geometry, held: dict[str, float]) -> None:
    """Check that the axes explain the gravity torque, and the lengths that of a payload."""
    q = np.random.default_rng(0).uniform(-2.5, 2.5, (30, geometry.n_joints))
    torque = robots.pinocchio_torque(text, geometry.joints, q, held)
    columns = ForwardKinematics(geometry.rotations, q).moment_columns()
    flat = columns.reshape(len(columns), -1).T
    moments = np.linalg.lstsq(flat, torque.T.ravel(), rcond=None)[0]
    np.testing.assert_allclose(flat @ moments, torque.T.ravel(), atol=1e-8)
    tool = np.array([MASS, *(MASS * COM)]) @ geometry.tool_moments()
    more = robots.pinocchio_torque(text, geometry.joints, q, held, (MASS, COM)) - torque
    np.testing.assert_allclose(Chain(geometry.rotations, tool.reshape(-1, 2)).torque(q), more,
                               atol=1e-8)


@pytest.mark.parametrize('text, joints, fixed, held', [
    (robots.UR, robots.UR_JOINTS, {}, {}),
    (robots.PANDA, robots.PANDA_JOINTS, {}, {}),
    # Positions of fingers do not affect the axes of the arm.
    (robots.PANDA, robots.PANDA_JOINTS, {'panda_finger_joint1': 0.02}, {}),
    (robots.BAXTER, tuple(f'left_{part}' for part in robots.BAXTER_PARTS), {}, {}),
    (robots.BAXTER, tuple(f'right_{part}' for part in robots.BAXTER_PARTS), {}, {}),
    # The position of a lift does not rotate gravity.
    (robots.TIAGO, robots.TIAGO_JOINTS, {'torso_lift_joint': 0.2}, {}),
    (robots.HUMANOID, robots.HUMANOID_ARM, {}, {'waist_pitch_joint': 0.0}),
    (robots.HUMANOID, robots.HUMANOID_ARM, {'waist_pitch_joint': 0.4},
     {'waist_pitch_joint': 0.4}),
    (robots.HUMANOID, ('waist_yaw_joint', 'waist_pitch_joint', *robots.HUMANOID_ARM), {}, {}),
    (robots.SO101, robots.SO101_JOINTS, {}, {}),
    # Joints within the arm that are not recorded.
    (robots.PANDA, ('panda_joint2', 'panda_joint4', 'panda_joint5'),
     {'panda_joint1': 0.2, 'panda_joint3': -0.7}, {'panda_joint3': -0.7}),
], ids=lambda value: None)
def test_axes_of_robots(text, joints, fixed, held):
    # Any order of the joints.
    geometry = described_arm(text, joints[::-1], fixed=fixed).geometry
    assert geometry.joints == joints
    assert {joint.name: joint.value for joint in geometry.held} == held
    check_axes(text, geometry, {**held, **fixed})


KINDS = strategies.sampled_from(('wanted', 'wanted', 'fixed', 'held', 'prismatic'))
VECTORS = strategies.tuples(*3 * [strategies.floats(-1.0, 1.0)])


@given(strategies.lists(strategies.tuples(KINDS, VECTORS, VECTORS, VECTORS,
                                          strategies.floats(-1.0, 1.0)), min_size=1, max_size=8))
def test_random_paths_agree_with_pinocchio(steps):
    parts, names, held = [], [], {}
    for n, (kind, xyz, rpy, axis, value) in enumerate(steps):
        if np.linalg.norm(axis) < 0.1:
            axis = (0.0, 0.6, 0.8)
        types = {'wanted': 'revolute', 'held': 'revolute'}
        parts.append(robots.joint(
            f'j{n}', f'l{n}', f'l{n + 1}', types.get(kind, kind),
            *(' '.join(map(str, vector)) for vector in (xyz, rpy, axis))))
        if kind == 'wanted':
            names.append(f'j{n}')
        elif kind != 'fixed':
            held[f'j{n}'] = value
    if not names:
        return
    text = robots.robot(*parts, root='l0')
    geometry = DescribedArm(parse_tree(text), names, recorded=held).geometry
    assert set(described_arm(text, names).held_joints()) >= {
        joint.name for joint in geometry.held}
    check_axes(text, geometry, held)


def test_joints_that_the_geometry_depends_on():
    humanoid = described_arm(robots.HUMANOID, robots.HUMANOID_ARM)
    assert humanoid.held_joints() == ('waist_pitch_joint',)
    assert described_arm(robots.TIAGO, robots.TIAGO_JOINTS).held_joints() == ()
    # A yaw joint after a tilted one matters; so does a lift within the arm.
    tilted = robots.robot(robots.joint('lean', 'base_link', 'a', rpy='0 0 0', axis='0 1 0'),
                          robots.joint('yaw', 'a', 'b'), robots.joint('up', 'b', 'c', 'prismatic'),
                          robots.joint('one', 'c', 'd', axis='1 0 0'),
                          robots.joint('slide', 'd', 'e', 'prismatic'),
                          robots.joint('two', 'e', 'f', axis='0 1 0'))
    assert described_arm(tilted, ('one', 'two')).held_joints() == ('lean', 'yaw', 'slide')


def test_positions_of_held_joints():
    one = robots.joint('waist', 'base_link', 'a', axis='0 1 0',
                       extra='<limit lower="0.5" upper="1.5"/>')
    text = robots.robot(one, robots.joint('arm', 'a', 'b', axis='0 1 0'))

    def held(**where):
        geometry = DescribedArm(parse_tree(text), ('arm',), **where).geometry
        return [(j.value, j.by) for j in geometry.held]

    assert held() == [(1.0, 'assumption')]  # its limits exclude 0
    assert held(recorded={'waist': 0.7}) == [(0.7, 'recording')]
    assert held(recorded={'waist': 0.7}, fixed={'waist': 0.0}) == [(0.0, 'option')]
    for wrong, message in (({'hip': 0.1}, 'has no joint hip'), ({'arm': 0.1}, 'part of the arm')):
        with pytest.raises(OptionError, match=message):
            held(fixed=wrong)
    with pytest.raises(OptionError, match='cannot be held'):
        held(fixed={'waist': float('nan')})


def test_mimic_joints():
    def text(leader):
        rule = f'<mimic joint="{leader}" multiplier="-2" offset="0.1"/>'
        return robots.robot(robots.joint('a', 'base_link', 'l1', axis='0 1 0'),
                            robots.joint('b', 'l1', 'l2', axis='0 1 0'),
                            robots.joint('follower', 'l2', 'l3', axis='0 1 0', extra=rule),
                            robots.joint('c', 'l3', 'l4', axis='1 0 0'))
    geometry = described_arm(text('b'), ('a', 'c'), fixed={'b': 0.3}).geometry
    assert [(j.name, round(j.value, 12)) for j in geometry.held] == [('b', 0.3),
                                                                     ('follower', -0.5)]
    assert described_arm(text('b'), ('a', 'c')).held_joints() == ('b',)
    with pytest.raises(ModelMismatchError, match='follower within the arm mimics a: a linkage'):
        described_arm(text('a'), ('a', 'b', 'c'))
    with pytest.raises(ModelMismatchError, match='follower mimics a; leave it out'):
        described_arm(text('a'), ('a', 'b', 'follower'))
    with pytest.raises(DataError, match='mimics absent, which is not there'):
        described_arm(text('absent'), ('a', 'b', 'c'))
    with pytest.raises(DataError, match='mimics itself'):
        described_arm(text('follower'), ('a', 'b', 'c'))


def test_selection_of_the_arm_joints():
    recorded = sorted([*robots.PANDA_JOINTS, 'panda_finger_joint1', 'panda_finger_joint2'])
    joints, left_out = parse_tree(robots.PANDA).arm_joints(recorded)
    assert joints == robots.PANDA_JOINTS
    assert set(left_out) == {'panda_finger_joint1', 'panda_finger_joint2'}
    both = [f'{side}_{part}' for side in ('left', 'right') for part in robots.BAXTER_PARTS]
    with pytest.raises(ModelMismatchError, match='2 different branches: left_s0.*[|] right_s0.*'
                                                 '--joints left_s0,left_s1,left_e0'):
        parse_tree(robots.BAXTER).arm_joints(both)
    with pytest.raises(ModelMismatchError, match='--rename left_joint1=panda_joint1,left_'):
        parse_tree(robots.PANDA).arm_joints([f'left_joint{k}' for k in range(1, 8)])
    with pytest.raises(ModelMismatchError, match='no joint elbow'):
        parse_tree(robots.PANDA).arm_joints(['elbow'])
    with pytest.raises(ModelMismatchError, match='torso_lift_joint is prismatic'):
        described_arm(robots.TIAGO, ('torso_lift_joint', *robots.TIAGO_JOINTS))


def test_namespace_blank_line_and_expanded_xacro():
    text = robots.UR.replace('<robot ', '<robot xmlns="http://www.ros.org" '
                             'xmlns:xacro="http://ros.org/wiki/xacro" ')
    plain = described_arm(robots.UR, robots.UR_JOINTS).geometry
    for other in (text, '\n\n' + text, '\ufeff' + text, b'\n' + text.encode()):
        again = described_arm(other, robots.UR_JOINTS).geometry
        np.testing.assert_array_equal(again.rotations, plain.rotations)


def test_a_malformed_axis_outside_the_arm_is_ignored():
    wheel = robots.joint('wheel', 'base_link', 'rim', 'continuous', axis='0 0 0')
    text = robots.UR.replace('</robot>', f'{wheel}</robot>')
    assert described_arm(text, robots.UR_JOINTS).geometry.joints == robots.UR_JOINTS
    with pytest.raises(DataError, match='axis of continuous joint wheel has no direction'):
        described_arm(text, ('wheel',))
