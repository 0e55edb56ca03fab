"""
Read from a URDF where the axes of an arm are: nothing else in it is used.

Masses and meshes are not looked at. The wanted joints must follow each other on one path through
the tree of joints; other branches and what follows the last of them (a gripper) do not matter.
Joints on the path that are not wanted are held at a value:

- a fixed joint is merged into its neighbours, whatever its axis;
- a prismatic joint before the arm, or a turn about the vertical, does not turn gravity in the
  arm's base, so that its value is of no interest;
- a waist, or a joint between two wanted ones, is held where an option or the recording says,
  otherwise at rest: at 0, or in the middle of its limits if 0 lies beyond them;
- a joint that mimics another is held where its rule puts it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
import math
from pathlib import Path

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.robot_tree import FREE, parse_tree, RobotTree, TreeJoint
from gravity_comp_ros.description.serial_arm import wanted_path
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
from gravity_comp_ros.models.kinematic.chain import aligned
from gravity_comp_ros.models.kinematic.geometry import Geometry, HeldJoint
import numpy as np

_MAX_BYTES = 32 * 2 ** 20
# An axis this near to the vertical turns nothing that gravity acts on.
_VERTICAL = 1e-6


@dataclass(frozen=True)
class HeldAt:
    """
    Where joints beside the wanted ones are, in rad (m if prismatic), by name.

    `fixed` is what an option says; `recorded` is what the recording says where no option does.

    :raises OptionError: if a value is not finite.
    """

    fixed: Mapping[str, float] = field(default_factory=dict)
    recorded: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in {**self.recorded, **self.fixed}.items():
            if not math.isfinite(value):
                raise OptionError(f'joint {name} cannot be held at {value}')


def read_urdf(path: Path | str, joints: Collection[str], held: HeldAt = HeldAt()) -> Geometry:
    """
    Return where the axes of `joints` are, in the order in which they follow each other.

    :raises DataError: if the file cannot be read or is no URDF.
    :raises ModelMismatchError: if it is of another arm.
    """
    return parse_urdf(read_text(path), joints, str(path), held)


def read_text(path: Path | str) -> bytes:
    """
    Return the content of a URDF file.

    :raises DataError: if it cannot be read, or is too large to be one.
    """
    path = Path(path)
    try:
        with path.open('rb') as stream:
            data = stream.read(_MAX_BYTES + 1)
    except OSError as problem:
        reason = (problem.strerror or 'unreadable').lower()
        raise DataError(f'cannot read URDF {path}: {reason}') from problem
    if len(data) > _MAX_BYTES:
        raise DataError(f'{path} is too large to be a URDF')
    return data


def parse_urdf(text: str | bytes, joints: Collection[str], source: str = 'URDF',
               held: HeldAt = HeldAt()) -> Geometry:
    """
    Return the same from a URDF's text, such as what /robot_description holds.

    :param source: what to call it in messages.
    :raises DataError: if it is no URDF.
    :raises ModelMismatchError: if it is of another arm.
    :raises OptionError: if `held.fixed` names a wanted joint, or one that the robot lacks.
    """
    tree = parse_tree(text, source)
    path = wanted_path(tree, joints)
    _check_fixed(tree, joints, held)
    return _Walk(tree, set(joints), held).geometry(path)


def held_joints(text: str | bytes, joints: Collection[str],
                source: str = 'URDF') -> tuple[str, ...]:
    """
    Return the joints whose values the geometry of `joints` depends on, from the base outwards.

    :raises DataError: as `parse_urdf`.
    :raises ModelMismatchError: as `parse_urdf`.
    """
    tree = parse_tree(text, source)
    walk = _Walk(tree, set(joints), HeldAt())
    walk.geometry(wanted_path(tree, joints))
    # Of a joint that mimics another the value comes from the other.
    names = (walk.leader(tree.joints[joint.name]).name for joint in walk.held)
    return tuple(dict.fromkeys(names))


def _check_fixed(tree: RobotTree, joints: Collection[str], held: HeldAt) -> None:
    for name in held.fixed:
        if name not in tree.joints:
            raise OptionError(f'{tree.source} has no joint {name} to hold')
        if name in joints:
            raise OptionError(f'joint {name} is one of the arm, so that it cannot be held at a '
                              f'value')


class _Walk:
    """The walk from the root to the last wanted joint."""

    def __init__(self, tree: RobotTree, wanted: set[str], held_at: HeldAt) -> None:
        self._tree, self._wanted, self._held_at = tree, wanted, held_at
        self.held: list[HeldJoint] = []
        self._in_arm, self._upright = False, True

    def geometry(self, path: list[TreeJoint]) -> Geometry:
        names, rotations, origins = [], [], []
        # The frame of the next link in that of the last axis.
        rotation, origin = np.eye(3), np.zeros(3)
        for joint in path:
            origin = origin + rotation @ joint.origin()
            rotation = rotation @ joint.rotation()
            if joint.name in self._wanted:
                turn = aligned(joint.axis())
                names.append(joint.name)
                rotations.append(rotation @ turn)
                origins.append(origin)
                rotation, origin = turn.T, np.zeros(3)
                self._in_arm = True
            elif joint.moves and joint.kind not in FREE:
                rotation, origin = self._hold(joint, rotation, origin)
        return Geometry(tuple(names), np.array(rotations), np.array(origins), path[-1].child,
                        rotation, tuple(self.held), self._tree.source)

    def _hold(self, joint: TreeJoint, rotation: FloatArray,
              origin: FloatArray) -> tuple[FloatArray, FloatArray]:
        axis = joint.axis()
        if not self._in_arm:
            tilts = joint.turns and abs((rotation @ axis)[2]) < 1.0 - _VERTICAL
            # What turns about the vertical matters only where something has tilted it.
            if not joint.turns or (self._upright and not tilts):
                return rotation, origin
            self._upright = False
        value, by = self._value(joint)
        self.held.append(HeldJoint(joint.name, value, by))
        if joint.turns:
            return rotation @ _about(axis, value), origin
        return rotation, origin + value * (rotation @ axis)

    def leader(self, joint: TreeJoint) -> TreeJoint:
        """Return the joint that decides where a joint is: itself, or the one that it mimics."""
        seen = [joint]
        while (rule := seen[-1].mimic) is not None:
            if rule.joint not in self._tree.joints:
                raise DataError(f'{self._tree.source}: joint {seen[-1].name} mimics '
                                f'{rule.joint}, which is not there')
            seen.append(self._tree.joints[rule.joint])
            if len(seen) > len(self._tree.joints):
                raise DataError(f'{self._tree.source}: joint {joint.name} mimics itself')
        return seen[-1]

    def _value(self, joint: TreeJoint) -> tuple[float, str]:
        if joint.name in self._held_at.fixed:
            return float(self._held_at.fixed[joint.name]), 'option'
        leader = self.leader(joint)
        if leader.name in self._wanted:
            raise ModelMismatchError(
                f'{self._tree.source}: joint {joint.name} within the arm mimics {leader.name}: a '
                f'linkage, which is no serial arm')
        if joint.mimic is not None:
            value, by = self._value(self._tree.joints[joint.mimic.joint])
            return joint.mimic.multiplier * value + joint.mimic.offset, by
        if joint.name in self._held_at.recorded:
            return float(self._held_at.recorded[joint.name]), 'recording'
        return joint.rest(), 'assumption'


def _about(axis: FloatArray, angle: float) -> FloatArray:
    """Return the rotation by `angle` about a unit vector (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew)
