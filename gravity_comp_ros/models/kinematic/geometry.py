"""
Axis directions and positions of an arm, usually from a robot description.

Learning gravity does not require them. With known directions only the moments of a chain are
fitted. With known lengths a payload has four parameters, its mass m and first moment m c, instead
of two moments of every link.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.kinematic.chain import are_rotations
import numpy as np

__all__ = ['Geometry', 'HeldJoint', 'HELD_BY', 'STANDARD_GRAVITY']

HELD_BY = ('option', 'recording', 'assumption')


@dataclass(frozen=True)
class HeldJoint:
    """
    A joint before or within the arm that is held at a fixed position and not learned.

    `value` is its position in rad (m for a prismatic joint), and `by` the source of the value: an
    option, the recording, or the assumption that it is at rest.

    :raises DataError: if the value is not finite, or the source is not in `HELD_BY`.
    """

    name: str
    value: float
    by: str

    def __post_init__(self) -> None:
        if not math.isfinite(self.value) or self.by not in HELD_BY:
            raise DataError(f'joint {self.name} held at {self.value} by {self.by}')


@dataclass(frozen=True, eq=False)
class Geometry:
    """
    The axes of N joints, from the base outwards.

    `rotations` (N, 3, 3) transform coordinates of frame i (before the rotation of joint i; its z
    is the axis) to frame i-1, the first to the base frame, whose z points up. `origins` (N, 3) in
    m are the origins of frame i in frame i-1. `link` is the name of the last joint's link, and
    `link_rotation` (3, 3) transforms that link's own coordinates to frame N. `held` are the other
    joints that the geometry depends on. `source` names the description in messages. `inertials`
    (N, 10) are the described parameters of the links in frames i (`rigid_body.PARAMETERS`), 0
    where the description has none. `base` are the numbers of its base parameters among the 10 N
    of the links (`arm_columns.basis_of`), empty if none were chosen: they differ with the angles.

    :raises DataError: if shapes disagree, a number is not finite, or a matrix is not a rotation.
    """

    joints: tuple[str, ...]
    rotations: FloatArray
    origins: FloatArray
    link: str
    link_rotation: FloatArray
    held: tuple[HeldJoint, ...] = ()
    source: str = ''
    inertials: FloatArray = field(default_factory=lambda: np.zeros((0, 10)))
    base: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.joints)
        if not len(self.inertials):
            object.__setattr__(self, 'inertials', np.zeros((n, 10)))
        for name, shape in (('rotations', (n, 3, 3)), ('origins', (n, 3)),
                            ('link_rotation', (3, 3)), ('inertials', (n, 10))):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not n:
                raise DataError(f'geometry: {name} {array.shape} for {n} joints')
            if not np.isfinite(array).all():
                raise DataError(f'geometry: a number of {name} is not finite')
            object.__setattr__(self, name, array)
        if not are_rotations(np.concatenate([self.rotations, self.link_rotation[None]])):
            raise DataError('geometry: an axis is not given by a rotation')
        if not set(self.base) <= set(range(10 * n)):
            raise DataError('geometry: a base parameter is none of the links')

    @property
    def n_joints(self) -> int:
        return len(self.joints)

    def moments(self) -> FloatArray:
        """
        Return the chain's moments (2 N, 10 N) per unit of the parameters of links in frames i.

        In N·m per kg and per kg m. Each link carries those beyond at the end of its own length; a
        moment along an axis acts as a moment of the link before (`chain`). Moments about vertical
        axes, the first ones, have no gravity torque and are 0.
        """
        n = self.n_joints
        moments = np.zeros((n, 10, n, 3))
        for k in range(n):
            moments[k, 0, :k] = self.origins[1:k + 1]
            moments[k, 1:4, k] = np.eye(3)
        for i in range(n - 1, 0, -1):
            moments[:, :, i - 1] += moments[:, :, i, 2:] * self.rotations[i][:, 2]
        moments[:, :, np.abs(np.cumprod(self.rotations[:, 2, 2])) > 1.0 - _PARALLEL] = 0.0
        return STANDARD_GRAVITY * moments[..., :2].reshape(10 * n, 2 * n).T

    def tool_moments(self) -> FloatArray:
        """
        Return the chain's moments (4, 2N) per unit of a payload's parameters.

        One row for its mass, in N·m/kg, and one for each component of its first moment in the
        coordinates of `link`, in N·m/(kg m), as in `moments`.
        """
        moments = self.moments().T[-10:-6]
        moments[1:] = self.link_rotation.T @ moments[1:]
        return moments


# Two axes are parallel up to this difference (1 minus the cosine).
_PARALLEL = 1e-9


def same_axes(geometry: Geometry, other: Geometry) -> bool:
    """Return whether two geometries differ at most in base tilt and zero angles."""
    if geometry.joints != other.joints:
        return False
    cosines = np.einsum('nji,njk->nik', geometry.rotations, other.rotations)[1:, 2, 2]
    return bool((cosines > 1.0 - _PARALLEL).all())


def zero_angle_differences(rotations: FloatArray, others: FloatArray) -> FloatArray:
    """
    Return the zero angles (N,) in rad of `others` relative to `rotations`; both (N, 3, 3).

    A misadjusted encoder zero is about a degree off, and a degree at the elbow changes the torque
    of the shoulder by percents. A fit on known axes estimates them (`regression.known_axes`).
    """
    relative = rotations.transpose(0, 2, 1) @ others
    return np.asarray(np.arctan2(relative[:, 1, 0], relative[:, 0, 0]))
