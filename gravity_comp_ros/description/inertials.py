"""The <inertial> of the links of a URDF: masses, centres of mass and inertias."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.robot_tree import rotation_of
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.printable import printable
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


def read_inertial(attribute: Callable[[str, str], str | None], link: str,
                  source: str) -> Inertial:
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
            wanted = 'a number' if count == 1 else f'{count} numbers'
            raise DataError(f'{source}: the {tag} of link {link} has {key}="{printable(text)}", '
                            f'not {wanted}')
        return values

    mass = float(numbers('mass', 'value', '0')[0])
    if mass < 0.0:
        raise DataError(f'{source}: link {link} has a mass of {mass:g} kg')
    rotation = rotation_of(numbers('origin', 'rpy', '0 0 0'))
    xx, xy, xz, yy, yz, zz = (float(numbers('inertia', key, '0')[0]) for key in INERTIA_KEYS)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(mass, numbers('origin', 'xyz', '0 0 0'), rotation,
                    rotation @ own @ rotation.T)
