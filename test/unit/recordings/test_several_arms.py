"""Recordings of several arms: refused, with the option that selects each arm."""

import re

from bench.shared.recordings import messages, write_folder
from gravity_comp_ros.cli import main
from gravity_comp_ros.errors import BagError
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
from gravity_comp_ros.recordings.mcap_writer import JointTopic, write_bag
from gravity_comp_ros.recordings.topic_choice import arms_by_message, arms_by_name
from hypothesis import given, strategies as st
import numpy as np
import pytest

UR = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
      'wrist_2_joint', 'wrist_3_joint')
ROBOTIQ = tuple(f'robotiq_85_{side}_{part}_joint' for side in ('left', 'right')
                for part in ('knuckle', 'inner_knuckle', 'finger_tip'))
XARM = tuple(f'joint{n}' for n in range(1, 8)) + (
    'drive_joint', 'left_finger_joint', 'left_inner_knuckle_joint', 'right_outer_knuckle_joint',
    'right_finger_joint', 'right_inner_knuckle_joint')
HUMAN = tuple(f'{part}_{way}' for part in ('shoulder', 'wrist')
              for way in ('roll', 'pitch', 'yaw')) + ('elbow_pitch',)


@pytest.mark.parametrize('names', [
    UR, UR + ROBOTIQ, XARM, HUMAN, tuple(f'iiwa_joint_{n}' for n in range(1, 8)),
    tuple(f'fr3_joint{n}' for n in range(1, 8)) + ('fr3_finger_joint1', 'fr3_finger_joint2'),
    ('1', '2', '3', '4', '5', '6'), ('shoulder_pan', 'shoulder_lift', 'elbow_flex', 'wrist_flex',
                                     'wrist_roll', 'gripper'), ()])
def test_single_arms_are_not_split(names):
    assert arms_by_name(names) == []


@pytest.mark.parametrize('pair', [
    ('left_{}', 'right_{}'), ('{}_l', '{}_r'), ('robot1/{}', 'robot2/{}'), ('LEFT_{}', 'RIGHT_{}'),
    ('dual.left.{}', 'dual.right.{}'), ('ur_a_{}', 'ur_b_{}')])
def test_two_arms_by_name(pair):
    arms = [tuple(form.format(name) for name in UR) for form in pair]
    mixed = [name for both in zip(*arms) for name in both] + ['torso_lift_joint']
    assert sorted(map(sorted, arms_by_name(mixed))) == sorted(map(sorted, arms))


@given(st.lists(st.text('abcdef', min_size=1, max_size=6), min_size=4, max_size=8, unique=True),
       st.integers(2, 4))
def test_any_number_of_arms(parts, count):
    arms = [tuple(f'arm{k}_{part}' for part in parts) for k in range(count)]
    assert sorted(arms_by_name([name for arm in arms for name in arm])) == sorted(arms)


def test_arms_in_separate_messages():
    left, right = ('a', 'b', 'c'), ('x', 'y')
    assert arms_by_message([left, right]) == [left, right]
    assert arms_by_message([left, ('gripper',)]) == []       # an arm has at least two joints
    assert arms_by_message([left, left[::-1], left + ('d',)]) == []


def moving(phase, count=400):
    t = np.arange(count) / 5.0
    q = np.column_stack([0.6 * np.sin(0.1 * t + phase + n) for n in range(4)])
    return t, q, np.gradient(q, t, axis=0), 5 * np.sin(q)


def refused(path, message):
    """Check that the recording is refused, and return the suggested values of --joints."""
    with pytest.raises(BagError, match=message) as caught:
        read_bag(path)
    return re.findall(r'--joints (\S+)', str(caught.value))


def test_two_arms_in_one_message(tmp_path, capsys):
    (t, q, qd, tau), (_, p, pd, sigma) = moving(0.0), moving(1.0)
    names = tuple(f'{side}_joint_{n}' for side in ('left', 'right') for n in range(1, 5))
    path = tmp_path / 'x.mcap'
    write_bag(path, [JointTopic('/joint_states', names, t, np.hstack([q, p]), np.hstack([qd, pd]),
                                np.hstack([tau, sigma]))])
    suggested = refused(path, 'the joints of 2 arms; choose one')
    assert suggested == [','.join(names[:4]), ','.join(names[4:])]
    for verb in ('info', 'fit', 'diagnose'):
        assert main([verb, str(path)]) == 1
        error = capsys.readouterr().err
        assert '2 arms' in error and error.count('\n') == 1
    for joints in suggested:
        # Each suggestion can be read, and so can all joints together.
        assert read_bag(path, ReadOptions(joints=tuple(joints.split(',')))).samples.n_joints == 4
    assert read_bag(path, ReadOptions(joints=names)).samples.n_joints == 8


def test_two_arms_by_message(tmp_path):
    first = messages(60)
    second = [[stamp + 1, {**row, 'names': [f'other_{name}' for name in row['names']]}]
              for stamp, row in messages(60)]
    rows = [row for both in zip(first, second) for row in both]
    path = write_folder(tmp_path / 'bag', {'/joint_states': rows})
    for joints in refused(path, 'the joints of 2 arms; choose one'):
        result = read_bag(path, ReadOptions(joints=tuple(joints.split(','))))
        assert len(result.samples) == 60


def test_names_that_change_are_no_second_arm(tmp_path):
    rows = messages(60)
    for _, row in rows[40:]:
        row['names'] = [f'other_{name}' for name in row['names']]
    path = write_folder(tmp_path / 'bag', {'/joint_states': rows})
    with pytest.raises(BagError, match='names of the joints change from shoulder') as error:
        read_bag(path)
    option = str(error.value).split('--rename ')[1].split(';')[0]
    rename = dict(part.split('=') for part in option.split(','))
    assert read_bag(path, ReadOptions(rename=rename)).samples.n_samples == 60


def test_two_robots_with_the_same_names(tmp_path):
    (_, q, qd, tau), (_, p, pd, sigma) = moving(0.0), moving(1.0)
    both = [np.stack(pair, axis=1).reshape(-1, 4)
            for pair in ((q, p), (qd, pd), (tau, sigma))]
    path = tmp_path / 'x.mcap'
    write_bag(path, [JointTopic('/joint_states', ('a', 'b', 'c', 'd'),
                                np.arange(len(both[0])) / 10.0, *both)])
    assert refused(path, 'two robots published the same joint names') == []
