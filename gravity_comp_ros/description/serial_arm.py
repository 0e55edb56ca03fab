"""Which joints of a robot make up one serial arm, and which path leads through them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from gravity_comp_ros.description.robot_tree import parse_tree, RobotTree, TreeJoint
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.printable import shown_names

_MOST_NAMES = 16


@dataclass(frozen=True)
class ArmJoints:
    """
    The joints of a recording that make up its arm, from the base outwards.

    `left_out` has the other ones with the reason, such as a gripper's.
    """

    joints: tuple[str, ...]
    left_out: dict[str, str]


def arm_joints(text: str | bytes, recorded: Sequence[str], source: str = 'URDF') -> ArmJoints:
    """
    Return the serial arm among the recorded joints.

    Prismatic joints and those that mimic another are left out: their torque is no sum of sines
    and cosines of their own angles.

    :raises DataError: if the text is no URDF.
    :raises ModelMismatchError: if a joint is not in it, or they are of several arms.
    """
    tree = parse_tree(text, source)
    _check_known(tree, recorded)
    left_out = {name: reason for name in recorded
                if (reason := _no_part_of_an_arm(tree.joints[name]))}
    wanted = [name for name in recorded if name not in left_out]
    path = wanted_path(tree, wanted)
    return ArmJoints(tuple(joint.name for joint in path if joint.name in wanted), left_out)


def wanted_path(tree: RobotTree, wanted: Collection[str]) -> list[TreeJoint]:
    """
    Return all joints from the root to the last wanted one, fixed ones included.

    :raises ModelMismatchError: if the wanted joints are not on one path, or one of them is no
        joint of a serial arm.
    """
    _check_known(tree, wanted)
    for name in wanted:
        reason = _no_part_of_an_arm(tree.joints[name])
        if reason:
            raise ModelMismatchError(f'{tree.source}: joint {name} {reason}; leave it out '
                                     f'(--joints)')
    paths = {name: tree.path(name) for name in wanted}
    longest = max(paths.values(), key=len)
    if not set(wanted) <= {joint.name for joint in longest}:
        raise ModelMismatchError(_several_arms(tree.source, paths))
    return longest


def _no_part_of_an_arm(joint: TreeJoint) -> str:
    """Return why a joint cannot be one of an arm's; '' if it can."""
    if not joint.turns:
        return f'is {joint.kind}: only revolute joints can be learned'
    if joint.mimic is not None:
        return f'mimics {joint.mimic.joint}'
    return ''


def _check_known(tree: RobotTree, wanted: Collection[str]) -> None:
    missing = sorted(set(wanted) - set(tree.joints))
    if missing or not wanted:
        known = [joint.name for joint in tree.joints.values() if joint.moves]
        raise ModelMismatchError(f'{tree.source} has no joint {", ".join(missing)}; it has '
                                 f'{shown_names(known, _MOST_NAMES)}')


def _several_arms(source: str, paths: dict[str, list[TreeJoint]]) -> str:
    """Return the message for joints of several branches: it names each branch's joints."""
    branches: list[list[str]] = []
    for path in sorted(paths.values(), key=len, reverse=True):
        names = [joint.name for joint in path if joint.name in paths]
        if not any(set(names) <= set(branch) for branch in branches):
            branches.append(names)
    listed = ' | '.join(shown_names(branch, _MOST_NAMES) for branch in branches)
    return (f'{source}: the joints are on {len(branches)} different branches: {listed}; name '
            f'those of one arm (--joints {",".join(branches[0])})')
