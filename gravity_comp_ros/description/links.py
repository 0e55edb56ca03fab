"""
Arm of a robot description: its axes, the links that it carries, and their masses.

The joints of the arm must be on one path through the joint tree. Other joints on that path are
treated as follows:

- a fixed joint is merged into its neighbours; its axis is ignored;
- a prismatic joint before the arm, or a rotation about the vertical, is ignored, because it does
  not rotate gravity in the base frame of the arm;
- a waist, or a joint between two joints of the arm, is held at a constant position: from an
  option, else from the recording, else 0 (the middle of its limits if they exclude 0);
- the position of a mimic joint follows from its rule.

Joints beyond an axis of the arm, such as those of a gripper, are at rest.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
import math
from types import MappingProxyType
from xml.etree.ElementTree import Element

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.robot_tree import (
    numbers_of, parse_tree, RobotTree, rotation_of, TreeJoint)
from gravity_comp_ros.errors import DataError, ModelMismatchError, OptionError
from gravity_comp_ros.models.kinematic.chain import about, aligned
from gravity_comp_ros.models.kinematic.geometry import Geometry, HeldJoint
from gravity_comp_ros.models.kinematic.rigid_body import PARAMETERS, regressor
from gravity_comp_ros.printable import printable, shown_names
import numpy as np

INERTIA_KEYS = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
# Maximum deviation of |z| of a unit axis from 1 for which the axis counts as vertical.
_VERTICAL = 1e-6
# Reach in m that is added to the lengths of an arm: its last link has none.
_MIN_REACH = 0.5
# Length in m that no link of an arm has; that of a few centimetres in mm has it.
_MAX_LENGTH = 20.0
# Negative second moment of a thin link, as a share of the largest, by rounded numbers.
_ROUNDING = 0.05
# Positions of joints outside the arm, by name, in rad (m if prismatic).
Positions = Mapping[str, float]
_NO_POSITIONS: Positions = MappingProxyType({})


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


class DescribedArm:
    """
    An arm in a robot description.

    `tree` are all joints and links of the description. `geometry` are the axes of the arm, with
    the inertial parameters of links that are possible.

    :param fixed: positions from an option, of other joints on the path to the last one of the arm.
    :param recorded: positions from the recording of joints that are not fixed.
    :raises DataError: if a length is in mm.
    :raises ModelMismatchError: if the joints are not those of one arm.
    :raises OptionError: if `fixed` names a joint of the arm or an unknown joint, or a position is
        not finite.
    """

    def __init__(self, tree: RobotTree, joints: Collection[str], fixed: Positions = _NO_POSITIONS,
                 recorded: Positions = _NO_POSITIONS) -> None:
        self.tree, self._arm, self._fixed, self._recorded = tree, set(joints), fixed, recorded
        path = tree.arm_path(joints)
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
        for name, origin in zip(names[1:], origins[1:]):
            _check_length(origin, f'{tree.source}: joint {name}')
        self.geometry = Geometry(tuple(names), np.array(rotations), np.array(origins),
                                 path[-1].child, place.rotation, tuple(self._held), tree.source)
        self.geometry = replace(self.geometry, inertials=frame_parameters(self, self._possible()))

    def held_joints(self) -> tuple[str, ...]:
        """
        Return the other joints whose positions the geometry depends on, from the base outwards.

        The position of a mimic joint is given by the joint that it mimics.
        """
        return tuple(dict.fromkeys(self.leader(self.tree.joints[joint.name]).name
                                   for joint in self.geometry.held))

    def _possible(self) -> dict[str, Inertial]:
        """Return the possible inertials; none if a number is wrong, which masses alone need."""
        reach = float(np.linalg.norm(self.geometry.origins, axis=1).sum()) + _MIN_REACH
        try:
            inertials = self.inertials(required=False)
        except DataError:
            return {}
        return {name: each for name, each in inertials.items() if each.is_possible(reach)}

    @cached_property
    def places(self) -> dict[str, LinkPlace]:
        """Return the places of the links that the arm carries, by name; the last joint's too."""
        places, waiting = dict(self._places), list(self.tree.joints.values())
        # Parents first: each pass places the children of the links placed before.
        while children := [joint for joint in waiting
                           if joint.parent in places and joint.child not in places]:
            for joint in children:
                place = places[joint.parent].then(joint.rotation(), joint.origin())
                places[joint.child] = place.moved(joint, self._at_rest(joint)) \
                    if joint.is_single else place
        return places

    def place(self, link: str) -> LinkPlace:
        """
        Return the place of a link.

        :raises ModelMismatchError: if the arm does not carry it.
        """
        if link not in self.places:
            raise ModelMismatchError(
                f'{self.geometry.source}: the arm carries no link {printable(link)}; it carries '
                f'{shown_names(list(self.places))}')
        return self.places[link]

    def inertials(self, required: bool = True) -> dict[str, Inertial]:
        """
        Return the inertials of the links of the arm, by name.

        :param required: whether some link must have a mass, and all centres lengths of an arm.
        :raises DataError: if no link of the arm has a mass, or a number is wrong.
        """
        result = {}
        for link in self.tree.root.iter('link'):
            name, inertial = printable(link.get('name', '')), link.find('inertial')
            if name in self.places and inertial is not None and len(inertial):
                result[name] = _inertial(inertial, name, self.tree.source)
        if required and not any(inertial.mass > 0.0 for inertial in result.values()):
            raise DataError(f'{self.tree.source} gives no mass to any link of the arm '
                            f'({shown_names(list(self.places))}): add an <inertial> with a rough '
                            f'mass to its links')
        for name, own in result.items() if required else ():
            _check_length(own.centre, f'{self.tree.source}: the centre of mass of {name}')
        return result

    def columns(self, q: FloatArray, links: Collection[str]) -> FloatArray:
        """
        Return the torque (M, N, 4L) per mass and first moment of links, at q (M, N) in rad.

        In N·m/kg and N·m/(kg m); the first moment is in the frame of the link.
        """
        rest = np.zeros_like(q)
        every = regressor(self.geometry, q, rest, rest, STANDARD_GRAVITY)
        frames = every.reshape(*q.shape, -1, len(PARAMETERS))[..., :4]
        result = []
        for place in map(self.place, links):
            to_frame = np.eye(4)
            to_frame[1:, 0], to_frame[1:, 1:] = place.origin, place.rotation
            result.append(frames[:, :, place.joint] @ to_frame)
        return np.concatenate(result, axis=2)

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
        for name, value in (*self._recorded.items(), *self._fixed.items()):
            if not math.isfinite(value):
                raise OptionError(f'joint {name} cannot be held at {value}')
        for name in self._fixed:
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
        if joint.name in self._fixed:
            return float(self._fixed[joint.name]), 'option'
        leader = self.leader(joint)
        if leader.name in self._arm:
            raise ModelMismatchError(
                f'{self.tree.source}: joint {joint.name} within the arm mimics {leader.name}: a '
                f'linkage, not a serial arm')
        if joint.mimic is not None:
            value, by = self._value(self.tree.joints[joint.mimic.joint])
            return joint.mimic.multiplier * value + joint.mimic.offset, by
        if joint.name in self._recorded:
            return float(self._recorded[joint.name]), 'recording'
        return joint.rest(), 'assumption'


def described_arm(text: str | bytes, joints: Collection[str], source: str = 'URDF',
                  fixed: Positions = _NO_POSITIONS) -> DescribedArm:
    """
    Return the arm of these joints in the text of a URDF.

    :raises DataError: if the text is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    """
    return DescribedArm(parse_tree(text, source), joints, fixed)


@dataclass(frozen=True, eq=False)
class Inertial:
    """
    A link's mass in kg, centre of mass (3,) in m, and inertia (3, 3) in kg m^2 about it.

    All are in the frame of the link; `rotation` (3, 3) is that of <origin>.
    """

    mass: float
    centre: FloatArray
    rotation: FloatArray
    inertia: FloatArray

    @property
    def second_moment(self) -> FloatArray:
        """Return the second moment of the mass about the centre (3, 3) in kg m^2."""
        return 0.5 * np.trace(self.inertia) * np.eye(3) - self.inertia

    def is_possible(self, reach: float) -> bool:
        """Return whether a link of an arm of this reach in m can have these numbers."""
        second = np.linalg.eigvalsh(self.second_moment)
        return bool(self.mass > 0.0 and np.linalg.norm(self.centre) < reach
                    and second.min() >= -_ROUNDING * abs(second).max()
                    and second.sum() < self.mass * reach ** 2)

    def about_origin(self) -> FloatArray:
        """Return m, m c and the six inertias about the frame's origin (10,)."""
        c = self.centre
        about = self.inertia + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return np.concatenate([[self.mass], self.mass * c, about[np.triu_indices(3)]])


def on_frame(arm: DescribedArm, link: str, inertial: Inertial) -> FloatArray:
    """Return the parameters (10,) of a link in the frame of the joint that carries it."""
    place = arm.place(link)
    return replace(inertial, centre=place.origin + place.rotation @ inertial.centre,
                   inertia=place.rotation @ inertial.inertia @ place.rotation.T).about_origin()


def frame_parameters(arm: DescribedArm, inertials: Mapping[str, Inertial]) -> FloatArray:
    """Return the parameters (N, 10) of all links of each frame, as `rigid_body.PARAMETERS`."""
    result = np.zeros((arm.geometry.n_joints, len(PARAMETERS)))
    for link, inertial in inertials.items():
        result[arm.place(link).joint] += on_frame(arm, link, inertial)
    return result


def _inertial(element: Element, link: str, source: str) -> Inertial:
    """
    Return the numbers of an <inertial>.

    :raises DataError: if one is not a number, or the mass is negative.
    """
    def numbers(tag: str, key: str, default: str) -> FloatArray:
        return numbers_of(element.find(tag), key, default, f'{source}: the {tag} of link {link}')

    mass = float(numbers('mass', 'value', '0')[0])
    if mass < 0.0:
        raise DataError(f'{source}: link {link} has a mass of {mass:g} kg')
    rotation = rotation_of(numbers('origin', 'rpy', '0 0 0'))
    xx, xy, xz, yy, yz, zz = (float(numbers('inertia', key, '0')[0]) for key in INERTIA_KEYS)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(mass, numbers('origin', 'xyz', '0 0 0'), rotation,
                    rotation @ own @ rotation.T)


def _check_length(origin: FloatArray, what: str) -> None:
    length = float(np.linalg.norm(origin))
    if length > _MAX_LENGTH:
        raise DataError(f'{what} is {length:.3g} m from the frame before it: is the description '
                        f'in mm? Lengths of a URDF are in m')
