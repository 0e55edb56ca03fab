"""Joint axes from a URDF, against Pinocchio."""

from pathlib import Path

from bench.shared.serial_arms import poses
from gravity_comp_ros.description.links import (
    described_arm, frame_parameters, urdf_inertials)
from gravity_comp_ros.description.urdf import parse_urdf, read_text
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.simulation import arms
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


def tool_chain(geometry: Geometry, mass: float, com) -> Chain:
    """Return a massless chain with a tool."""
    numbers = np.array([mass, *(mass * np.asarray(com))])
    return Chain(geometry.rotations, (numbers @ geometry.tool_moments()).reshape(-1, 2))


def arm_without_fingers(tmp_path) -> arms.Arm:
    path = tmp_path / 'bent.urdf'
    path.write_text(TILTED.replace('type="prismatic"', 'type="fixed"'))
    return arms.from_urdf(path)


@pytest.mark.parametrize('mass, com', [(2.0, (0.0, 0.0, 0.1)), (-1.0, (0.02, 0.3, -0.1))])
def test_torque_of_a_tool_agrees_with_pinocchio(tmp_path, mass, com):
    iiwa = arms.iiwa7()
    for arm, geometry in ((iiwa, parse_urdf(IIWA.read_bytes(), iiwa.joints)),
                          (arm_without_fingers(tmp_path), parse_urdf(TILTED, ('a', 'b', 'c')))):
        q = poses(30, arm.n_joints)
        heavier = arms.with_payload(arm, arms.Payload(abs(mass), com))
        expected = arms.gravity_torque(heavier, q) - arms.gravity_torque(arm, q)
        torque = tool_chain(geometry, mass, com).torque(q)
        np.testing.assert_allclose(torque, np.sign(mass) * expected, atol=1e-6)


def test_the_urdf_matches_the_simulated_arm():
    arm, again = arms.iiwa7(), arms.from_urdf(IIWA)
    q = poses(20, 7)
    np.testing.assert_allclose(arms.gravity_torque(again, q), arms.gravity_torque(arm, q),
                               atol=1e-6)
    np.testing.assert_allclose(again.upper, arm.upper, atol=1e-8)
    assert again.joints == arm.joints


def test_joints_are_in_the_order_of_the_arm():
    geometry = parse_urdf(TILTED, ('c', 'a', 'b'))
    assert geometry.joints == ('a', 'b', 'c') and geometry.link == 'hand'
    # The first joints of an arm are an arm.
    assert parse_urdf(TILTED, ('b', 'a')).link == 'two'


@pytest.mark.parametrize('text, joints, error, message', [
    (TILTED, ('a', 'x'), ModelMismatchError, 'has no joint x; it has a, b, c, finger'),
    (TILTED, ('a', 'b', 'c', 'finger'), ModelMismatchError, 'finger is prismatic'),
    (TILTED.replace('<parent link="two"/>', '<parent link="base"/>'),
     ('a', 'b', 'c'), ModelMismatchError, 'different branches'),
    ('<robot', ('a',), DataError, 'not a URDF'),
    ('<sdf/>', ('a',), DataError, '<sdf>'),
    ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:arg name="x"/></robot>', ('a',),
     DataError, 'xacro'),
    (TILTED.replace('xyz="0.1 0 0.2"', 'xyz="${reach} 0 0"'), ('a',), DataError, 'xacro'),
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
        parse_urdf(text, joints, 'arm.urdf')
    assert '\n' not in str(caught.value)


def test_entities_are_refused():
    bomb = ('<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>'
            '<robot name="&b;"/>')
    with pytest.raises(DataError, match='not a URDF'):
        parse_urdf(bomb, ('a',))
    outside = '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot name="&a;"/>'
    with pytest.raises(DataError, match='not a URDF'):
        parse_urdf(outside, ('a',))


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(DataError, match='no such file'):
        read_text(tmp_path / 'none.urdf')
    with pytest.raises(DataError, match='not a URDF'):
        parse_urdf(b'\xff\xfe\x00<robot>', ('a',))


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
    np.testing.assert_allclose(arm.geometry.inertials, frame_parameters(
        arm, urdf_inertials(slim, arm, 'arm.urdf')))
    np.testing.assert_allclose(arm.geometry.inertials[:, 0], [2.0, 1.5, 1.0])
    again = Geometry.from_json(arm.geometry.to_json())
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
