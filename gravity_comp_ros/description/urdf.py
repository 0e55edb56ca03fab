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
    arm_path, parse_tree, RobotTree, TreeJoint)
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


@dataclass(frozen=True)
class Description:
    """Text of a URDF, its name in messages, and the folder of its file, if it is one."""

    text: str | bytes
    source: str
    folder: Path | None = None


def find_description(urdf: Path | str | None, recordings: Collection[Path | str]
                     ) -> Description | None:
    """
    Return the description in a file, without one that of the first recording which has one.

    :raises DataError: if the file cannot be read.
    :raises BagError: if a recording cannot be read, or its description is damaged.
    """
    if urdf is not None:
        return Description(read_text(urdf), str(urdf), Path(urdf).resolve().parent)
    for recording in recordings:
        # Imports file-format libraries, which arrays do not need.
        from gravity_comp_ros.recordings.bag import robot_description
        recorded = robot_description(recording)
        if recorded is not None:
            return Description(recorded.text, recorded.source)
    return None


def parse_urdf(text: str | bytes, joints: Collection[str], source: str = 'URDF',
               held: HeldPositions = HeldPositions()) -> Geometry:
    """
    Return the axes of `joints`, from the base outwards, from the text of a URDF.

    :param source: name of the description in messages.
    :raises DataError: if the text is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    :raises OptionError: if `held.fixed` names a joint of the arm or an unknown joint.
    """
    return Traversal(parse_tree(text, source), joints, held).geometry


def held_joints(text: str | bytes, joints: Collection[str],
                source: str = 'URDF') -> tuple[str, ...]:
    """
    Return the other joints whose positions the geometry depends on, from the base outwards.

    :raises DataError: as `parse_urdf`.
    :raises ModelMismatchError: as `parse_urdf`.
    """
    known = Traversal(parse_tree(text, source), joints)
    # The position of a mimic joint is given by the joint that it mimics.
    names = (known.leader(known.tree.joints[joint.name]).name for joint in known.geometry.held)
    return tuple(dict.fromkeys(names))


@dataclass(frozen=True, eq=False)
class LinkPlace:
    """
    A link fixed to the arm: `rotation` (3, 3) and `origin` (3,) in m in frame `joint`.

    Frame number `joint` (from 0) turns with the joint of that number; its z is the axis. Frame -1
    is that of the base.
    """

    joint: int
    rotation: FloatArray
    origin: FloatArray

    def then(self, rotation: FloatArray, origin: FloatArray = np.zeros(3)) -> LinkPlace:
        """Return the place of a frame that has this place in this link."""
        return LinkPlace(self.joint, self.rotation @ rotation,
                         self.origin + self.rotation @ origin)

    def moved(self, joint: TreeJoint, value: float) -> LinkPlace:
        """Return the place after a joint at a position in rad, or m if it is prismatic."""
        if joint.revolute:
            return self.then(about(joint.axis(), value))
        return self.then(np.eye(3), value * joint.axis())


class Traversal:
    """
    Traversal of the path from the root to the last joint of the arm, and of what it carries.

    :raises ModelMismatchError: if the joints are not those of one arm.
    :raises OptionError: if `positions.fixed` names a joint of the arm or an unknown joint.
    """

    def __init__(self, tree: RobotTree, joints: Collection[str],
                 positions: HeldPositions = HeldPositions()) -> None:
        self.tree, self._arm, self._positions = tree, set(joints), positions
        path = arm_path(tree, joints)
        self._check_fixed()
        self._held: list[HeldJoint] = []
        self._upright, self._places = True, dict[str, LinkPlace]()
        names, rotations, origins = [], [], []
        place = LinkPlace(-1, np.eye(3), np.zeros(3))
        for joint in path:
            place = place.then(joint.rotation(), joint.origin())
            if joint.name in self._arm:
                to_axis = aligned(joint.axis())
                names.append(joint.name)
                rotations.append(place.rotation @ to_axis)
                origins.append(place.origin)
                place = LinkPlace(len(names) - 1, to_axis.T, np.zeros(3))
            elif joint.is_single:
                place = self._hold(joint, place)
            if names:
                self._places[joint.child] = place
        self.geometry = Geometry(tuple(names), np.array(rotations), np.array(origins),
                                 path[-1].child, place.rotation, tuple(self._held), tree.source)

    def carried(self) -> dict[str, LinkPlace]:
        """Return the places of the links that the arm carries, by name; other joints at rest."""
        places, waiting = dict(self._places), list(self.tree.joints.values())
        # Parents first: each pass places the children of the links placed before.
        while children := [joint for joint in waiting
                           if joint.parent in places and joint.child not in places]:
            for joint in children:
                place = places[joint.parent].then(joint.rotation(), joint.origin())
                places[joint.child] = place.moved(joint, self._at_rest(joint)) \
                    if joint.is_single else place
        return places

    def _at_rest(self, joint: TreeJoint) -> float:
        rule = joint.mimic
        leader = None if rule is None else self.tree.joints.get(rule.joint)
        return joint.rest() if rule is None or leader is None \
            else rule.multiplier * leader.rest() + rule.offset

    def _hold(self, joint: TreeJoint, place: LinkPlace) -> LinkPlace:
        """Return the place after a joint outside the arm; add it to `_held` if it matters."""
        if place.joint < 0:
            tilts = joint.revolute and abs((place.rotation @ joint.axis())[2]) < 1.0 - _VERTICAL
            # A rotation about the vertical matters only after a tilting joint.
            if not joint.revolute or (self._upright and not tilts):
                return place
            self._upright = False
        value, by = self._value(joint)
        self._held.append(HeldJoint(joint.name, value, by))
        return place.moved(joint, value)

    def _check_fixed(self) -> None:
        for name in self._positions.fixed:
            if name not in self.tree.joints:
                raise OptionError(f'{self.tree.source} has no joint {name} to hold')
            if name in self._arm:
                raise OptionError(f'joint {name} is part of the arm and cannot be held at a '
                                  f'constant position')

    def leader(self, joint: TreeJoint) -> TreeJoint:
        """Return the joint that a joint mimics, directly or indirectly; else the joint itself."""
        seen = [joint]
        while (rule := seen[-1].mimic) is not None:
            if rule.joint not in self.tree.joints:
                raise DataError(f'{self.tree.source}: joint {seen[-1].name} mimics '
                                f'{rule.joint}, which is not there')
            seen.append(self.tree.joints[rule.joint])
            if len(seen) > len(self.tree.joints):
                raise DataError(f'{self.tree.source}: joint {joint.name} mimics itself')
        return seen[-1]

    def _value(self, joint: TreeJoint) -> tuple[float, str]:
        """Return the position of a held joint, and its source."""
        if joint.name in self._positions.fixed:
            return float(self._positions.fixed[joint.name]), 'option'
        leader = self.leader(joint)
        if leader.name in self._arm:
            raise ModelMismatchError(
                f'{self.tree.source}: joint {joint.name} within the arm mimics {leader.name}: a '
                f'linkage, not a serial arm')
        if joint.mimic is not None:
            value, by = self._value(self.tree.joints[joint.mimic.joint])
            return joint.mimic.multiplier * value + joint.mimic.offset, by
        if joint.name in self._positions.recorded:
            return float(self._positions.recorded[joint.name]), 'recording'
        return joint.rest(), 'assumption'
