"""Joint order from a description, from numbers or words in the names, or as recorded."""

from bench.shared import urdf_snippets as robots
from gravity_comp_ros.description.joint_order import (
    AS_RECORDED, DESCRIPTION, joint_order, JointOrder, NUMBERS, WORDS)
from hypothesis import given, strategies
import pytest


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
    assert joint_order(shuffled) == JointOrder(tuple(names), NUMBERS)


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
    assert joint_order(shuffled) == JointOrder(tuple(names), WORDS)


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
