"""The <inertial> of the links of a URDF: masses, centres of mass and inertias."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from defusedxml.ElementTree import fromstring
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.link_places import DescribedArm
from gravity_comp_ros.description.robot_tree import rotation_of
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.kinematic.rigid_body import PARAMETERS
from gravity_comp_ros.printable import printable, shown_names
import numpy as np

INERTIA_KEYS = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


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


def urdf_inertials(text: str | bytes, arm: DescribedArm, source: str,
                   required: bool = True) -> dict[str, Inertial]:
    """
    Return the inertials of the links of an arm, by name.

    :param required: whether some link must have a mass.
    :raises DataError: if no link of the arm has a mass, or a number is wrong.
    """
    result = {}
    for link in fromstring(text.strip()).iter():
        name = printable(link.get('name', ''))
        if not str(link.tag).endswith('link') or name not in arm.places:
            continue
        parts = {str(part.tag).rpartition('}')[2]: part for inertial in link
                 if str(inertial.tag).endswith('inertial') for part in inertial}

        def attribute(tag: str, key: str, parts: dict = parts) -> str | None:
            return parts[tag].get(key) if tag in parts else None

        if parts:
            result[name] = _inertial(attribute, name, source)
    if required and not any(inertial.mass > 0.0 for inertial in result.values()):
        raise DataError(f'{source} gives no mass to any link of the arm '
                        f'({shown_names(list(arm.places))}): add an <inertial> with a rough mass '
                        f'to its links')
    return result


def _inertial(attribute: Callable[[str, str], str | None], link: str, source: str) -> Inertial:
    """
    Return the numbers of an <inertial>.

    :param attribute: of a child element, by its tag and the key; None where it is missing.
    :raises DataError: if one is not a number, or the mass is negative.
    """
    def numbers(tag: str, key: str, default: str) -> FloatArray:
        text = attribute(tag, key)
        text = default if text is None else text
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.zeros(0)
        count = len(default.split())
        if len(values) != count or not np.isfinite(values).all():
            expected = 'a number' if count == 1 else f'{count} numbers'
            raise DataError(f'{source}: the {tag} of link {link} has {key}="{printable(text)}", '
                            f'not {expected}')
        return values

    mass = float(numbers('mass', 'value', '0')[0])
    if mass < 0.0:
        raise DataError(f'{source}: link {link} has a mass of {mass:g} kg')
    rotation = rotation_of(numbers('origin', 'rpy', '0 0 0'))
    xx, xy, xz, yy, yz, zz = (float(numbers('inertia', key, '0')[0]) for key in INERTIA_KEYS)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(mass, numbers('origin', 'xyz', '0 0 0'), rotation,
                    rotation @ own @ rotation.T)
