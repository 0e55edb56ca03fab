"""
Joint axes of an arm from a URDF; masses and meshes are not read.

The joints of the arm must be on one path through the joint tree. Other branches, and joints after
the last one of the arm (a gripper), are ignored. Other joints on the path are treated as follows:

- a fixed joint is merged into its neighbours; its axis is ignored;
- a prismatic joint before the arm, or a rotation about the vertical, is ignored, because it does
  not rotate gravity in the base frame of the arm;
- a waist, or a joint between two joints of the arm, is held at a constant position: from an
  option, else from the recording, else 0 (the middle of its limits if they exclude 0);
- the position of a mimic joint follows from its rule.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
import math
from pathlib import Path

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.robot_tree import (
    arm_path, FREE, parse_tree, RobotTree, TreeJoint)
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
from gravity_comp_ros.models.kinematic.chain import about, aligned
from gravity_comp_ros.models.kinematic.geometry import Geometry, HeldJoint
import numpy as np

_MAX_BYTES = 32 * 2 ** 20
# Maximum deviation of |z| of a unit axis from 1 for which the axis counts as vertical.
_VERTICAL = 1e-6


@dataclass(frozen=True)
class HeldPositions:
    """
    Constant positions of joints outside the arm, by name, in rad (m if prismatic).

    `fixed` come from an option. `recorded` come from the recording; `fixed` takes precedence.

    :raises OptionError: if a value is not finite.
    """

    fixed: Mapping[str, float] = field(default_factory=dict)
    recorded: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in {**self.recorded, **self.fixed}.items():
            if not math.isfinite(value):
                raise OptionError(f'joint {name} cannot be held at {value}')


def read_text(path: Path | str, kind: str = 'URDF') -> bytes:
    """
    Return the content of a robot description.

    :param kind: format of the file, for messages.
    :raises DataError: if it cannot be read or is too large.
    """
    path = Path(path)
    try:
        with path.open('rb') as stream:
            data = stream.read(_MAX_BYTES + 1)
    except OSError as problem:
        reason = (problem.strerror or 'unreadable').lower()
        raise DataError(f'cannot read {kind} {path}: {reason}') from problem
    if len(data) > _MAX_BYTES:
        raise DataError(f'{path} is too large to be a robot description')
    return data


def parse_urdf(text: str | bytes, joints: Collection[str], source: str = 'URDF',
               held: HeldPositions = HeldPositions()) -> Geometry:
    """
    Return the axes of `joints`, from the base outwards, from the text of a URDF.

    :param source: name of the description in messages.
    :raises DataError: if the text is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    :raises OptionError: if `held.fixed` names a joint of the arm or an unknown joint.
    """
    tree = parse_tree(text, source)
    path = arm_path(tree, joints)
    _check_fixed(tree, joints, held)
    return _Traversal(tree, set(joints), held).geometry(path)


def held_joints(text: str | bytes, joints: Collection[str],
                source: str = 'URDF') -> tuple[str, ...]:
    """
    Return the other joints whose positions the geometry depends on, from the base outwards.

    :raises DataError: as `parse_urdf`.
    :raises ModelMismatchError: as `parse_urdf`.
    """
    tree = parse_tree(text, source)
    traversal = _Traversal(tree, set(joints), HeldPositions())
    traversal.geometry(arm_path(tree, joints))
    # The position of a mimic joint is given by the joint that it mimics.
    names = (traversal.leader(tree.joints[joint.name]).name for joint in traversal.held)
    return tuple(dict.fromkeys(names))


def _check_fixed(tree: RobotTree, joints: Collection[str], held: HeldPositions) -> None:
    for name in held.fixed:
        if name not in tree.joints:
            raise OptionError(f'{tree.source} has no joint {name} to hold')
        if name in joints:
            raise OptionError(f'joint {name} is part of the arm and cannot be held at a '
                              f'constant position')


class _Traversal:
    """Traversal of a path from the root to the last joint of the arm."""

    def __init__(self, tree: RobotTree, arm: set[str], positions: HeldPositions) -> None:
        self._tree, self._arm, self._positions = tree, arm, positions
        self.held: list[HeldJoint] = []
        self._in_arm, self._upright = False, True

    def geometry(self, path: list[TreeJoint]) -> Geometry:
        names, rotations, origins = [], [], []
        # Frame of the next link relative to the last axis.
        rotation, origin = np.eye(3), np.zeros(3)
        for joint in path:
            origin = origin + rotation @ joint.origin()
            rotation = rotation @ joint.rotation()
            if joint.name in self._arm:
                to_axis = aligned(joint.axis())
                names.append(joint.name)
                rotations.append(rotation @ to_axis)
                origins.append(origin)
                rotation, origin = to_axis.T, np.zeros(3)
                self._in_arm = True
            elif joint.moves and joint.kind not in FREE:
                rotation, origin = self._hold(joint, rotation, origin)
        return Geometry(tuple(names), np.array(rotations), np.array(origins), path[-1].child,
                        rotation, tuple(self.held), self._tree.source)

    def _hold(self, joint: TreeJoint, rotation: FloatArray,
              origin: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the frame after a joint outside the arm; add it to `held` if it matters."""
        axis = joint.axis()
        if not self._in_arm:
            tilts = joint.revolute and abs((rotation @ axis)[2]) < 1.0 - _VERTICAL
            # A rotation about the vertical matters only after a tilting joint.
            if not joint.revolute or (self._upright and not tilts):
                return rotation, origin
            self._upright = False
        value, by = self._value(joint)
        self.held.append(HeldJoint(joint.name, value, by))
        if joint.revolute:
            return rotation @ about(axis, value), origin
        return rotation, origin + value * (rotation @ axis)

    def leader(self, joint: TreeJoint) -> TreeJoint:
        """Return the joint that a joint mimics, directly or indirectly; else the joint itself."""
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
        """Return the position of a held joint, and its source."""
        if joint.name in self._positions.fixed:
            return float(self._positions.fixed[joint.name]), 'option'
        leader = self.leader(joint)
        if leader.name in self._arm:
            raise ModelMismatchError(
                f'{self._tree.source}: joint {joint.name} within the arm mimics {leader.name}: a '
                f'linkage, not a serial arm')
        if joint.mimic is not None:
            value, by = self._value(self._tree.joints[joint.mimic.joint])
            return joint.mimic.multiplier * value + joint.mimic.offset, by
        if joint.name in self._positions.recorded:
            return float(self._positions.recorded[joint.name]), 'recording'
        return joint.rest(), 'assumption'
