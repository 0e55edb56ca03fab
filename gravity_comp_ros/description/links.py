"""Links that an arm carries: their places, masses and inertias, and the torque of the masses."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from xml.etree.ElementTree import Element

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.robot_tree import (
    numbers_of, parse_tree, RobotTree, rotation_of)
from gravity_comp_ros.description.urdf import HeldPositions, LinkPlace, Traversal
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.rigid_body import PARAMETERS, regressor
from gravity_comp_ros.printable import printable, shown_names
import numpy as np

INERTIA_KEYS = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
# Reach in m that is added to the lengths of an arm: its last link has none.
_MIN_REACH = 0.5
# Negative second moment of a thin link, as a share of the largest, by rounded numbers.
_ROUNDING = 0.05


@dataclass(frozen=True, eq=False)
class DescribedArm:
    """
    An arm with the places of all links that it carries, by name; the last joint's included.

    `tree` are all joints and links of its description.
    """

    geometry: Geometry
    places: Mapping[str, LinkPlace]
    tree: RobotTree

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

        :param required: whether some link must have a mass.
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
        return result

    def to_frames(self, links: Collection[str]) -> FloatArray:
        """
        Return the matrix (4N, 4L) from masses and first moments of links to those of frames.

        The first moments are in the frame of each link, and in the frames of the joints about
        their origins; links on one frame add.
        """
        result = np.zeros((self.geometry.n_joints, 4, len(links), 4))
        for number, link in enumerate(links):
            place = self.place(link)
            result[place.joint, 0, number, 0] = 1.0
            result[place.joint, 1:, number, 0] = place.origin
            result[place.joint, 1:, number, 1:] = place.rotation
        return result.reshape(4 * self.geometry.n_joints, -1)

    def columns(self, q: FloatArray, links: Collection[str]) -> FloatArray:
        """
        Return the torque (M, N, 4L) per mass and first moment of links, at q (M, N) in rad.

        In N·m/kg and N·m/(kg m); the first moment is in the frame of the link.
        """
        rest = np.zeros_like(q)
        every = regressor(self.geometry, q, rest, rest, STANDARD_GRAVITY)
        frames = every.reshape(*q.shape, -1, len(PARAMETERS))[..., :4]
        return np.asarray(frames.reshape(*q.shape, -1) @ self.to_frames(links))


def described_arm(text: str | bytes, joints: Collection[str], source: str = 'URDF',
                  held: HeldPositions = HeldPositions()) -> DescribedArm:
    """
    Return the arm of these joints in a URDF with the links that it carries.

    Other joints beyond an axis of the arm, such as those of a gripper, are at rest. The geometry
    has the inertial parameters of links that are possible.

    :raises DataError: if the text is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    """
    known = Traversal(parse_tree(text, source), joints, held)
    arm = DescribedArm(known.geometry, known.carried(), known.tree)
    reach = float(np.linalg.norm(known.geometry.origins, axis=1).sum()) + _MIN_REACH
    try:
        inertials = arm.inertials(required=False)
    except DataError:
        # Axes are learned from without masses; what requires masses names the wrong number.
        inertials = {}
    possible = {name: each for name, each in inertials.items() if each.is_possible(reach)}
    return replace(arm, geometry=replace(arm.geometry, inertials=frame_parameters(arm, possible)))


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
