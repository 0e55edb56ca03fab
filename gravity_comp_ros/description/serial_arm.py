"""Selection of the joints of one serial arm, and their path through the joint tree."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from gravity_comp_ros.description.robot_tree import parse_tree, RobotTree, TreeJoint
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.printable import shown_names

_MAX_NAMES = 16


@dataclass(frozen=True)
class ArmJoints:
    """
    Recorded joints of the arm, from the base outwards.

    `left_out` are the other recorded joints, such as those of a gripper, with the reason.
    """

    joints: tuple[str, ...]
    left_out: dict[str, str]


def arm_joints(text: str | bytes, recorded: Sequence[str], source: str = 'URDF') -> ArmJoints:
    """
    Return the serial arm among the recorded joints.

    Prismatic joints and mimic joints are left out, because the gravity model requires independent
    revolute joints.

    :raises DataError: if the text is not a URDF.
    :raises ModelMismatchError: if a joint is missing in it, or the joints are on several arms.
    """
    tree = parse_tree(text, source)
    _check_known(tree, recorded)
    left_out = {name: reason for name in recorded
                if (reason := _exclusion(tree.joints[name]))}
    selected = [name for name in recorded if name not in left_out]
    path = arm_path(tree, selected)
    return ArmJoints(tuple(joint.name for joint in path if joint.name in selected), left_out)


def arm_path(tree: RobotTree, joints: Collection[str]) -> list[TreeJoint]:
    """
    Return all joints from the root to the last of these joints, including fixed ones.

    :raises ModelMismatchError: if the joints are not on one path, or one is not an independent
        revolute joint.
    """
    _check_known(tree, joints)
    for name in joints:
        reason = _exclusion(tree.joints[name])
        if reason:
            raise ModelMismatchError(f'{tree.source}: joint {name} {reason}; leave it out '
                                     f'(--joints)')
    paths = {name: tree.path(name) for name in joints}
    longest = max(paths.values(), key=len)
    if not set(joints) <= {joint.name for joint in longest}:
        raise ModelMismatchError(_several_arms(tree.source, paths))
    return longest


def _exclusion(joint: TreeJoint) -> str:
    """Return the reason why a joint cannot be part of an arm; '' if it can."""
    if not joint.revolute:
        return f'is {joint.kind}: only revolute joints are supported'
    if joint.mimic is not None:
        return f'mimics {joint.mimic.joint}'
    return ''


def _check_known(tree: RobotTree, joints: Collection[str]) -> None:
    missing = sorted(set(joints) - set(tree.joints))
    if missing or not joints:
        known = [joint.name for joint in tree.joints.values() if joint.moves]
        raise ModelMismatchError(f'{tree.source} has no joint {", ".join(missing)}; it has '
                                 f'{shown_names(known, _MAX_NAMES)}')


def _several_arms(source: str, paths: dict[str, list[TreeJoint]]) -> str:
    """Return the error message for joints on several branches, with the joints of each branch."""
    branches: list[list[str]] = []
    for path in sorted(paths.values(), key=len, reverse=True):
        names = [joint.name for joint in path if joint.name in paths]
        if not any(set(names) <= set(branch) for branch in branches):
            branches.append(names)
    listed = ' | '.join(shown_names(branch, _MAX_NAMES) for branch in branches)
    return (f'{source}: the joints are on {len(branches)} different branches: {listed}; choose '
            f'those of one arm (--joints {",".join(branches[0])})')
