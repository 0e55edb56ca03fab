"""
Where the axes of an arm are, for those who know: directions help a fit, lengths weigh a tool.

Nothing here is needed to learn gravity. With the directions only the moments of a chain are left
to fit; with the lengths a tool is four numbers, its mass m and first moment m c, instead of
two moments of every link.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
import numpy as np

__all__ = ['Geometry', 'HeldJoint', 'HELD_BY', 'STANDARD_GRAVITY']

HELD_BY = ('option', 'recording', 'assumption')


@dataclass(frozen=True)
class HeldJoint:
    """
    A joint that carries the arm or lies within it, but is none of its N joints.

    `value` in rad (m for a prismatic joint) is what the geometry takes it to be at, and `by`
    says why: an option, the recording, or the assumption that it is at rest.

    :raises DataError: if the value is not finite, or the reason is none of `HELD_BY`.
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

    `rotations` (N, 3, 3) turn the coordinates of frame i (before joint i turns; its z is the
    axis) into those of frame i-1, the first into those of the base, whose z points up. `origins`
    (N, 3) in m say where axis i lies in frame i-1. `link` names what the last joint moves, and
    `link_rotation` (3, 3) turns that link's own coordinates into those of frame N. `held` are
    the other joints that all this depends on. `source` names the description for messages.

    :raises DataError: if shapes disagree, a number is not finite, or one is no rotation.
    """

    joints: tuple[str, ...]
    rotations: FloatArray
    origins: FloatArray
    link: str
    link_rotation: FloatArray
    held: tuple[HeldJoint, ...] = ()
    source: str = ''

    def __post_init__(self) -> None:
        n = len(self.joints)
        for name, shape in (('rotations', (n, 3, 3)), ('origins', (n, 3)),
                            ('link_rotation', (3, 3))):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not n:
                raise DataError(f'geometry: {name} {array.shape} for {n} joints')
            if not np.isfinite(array).all():
                raise DataError(f'geometry: {name} hold a number that is not finite')
            object.__setattr__(self, name, array)
        every = np.concatenate([self.rotations, self.link_rotation[None]])
        off = np.abs(every @ every.transpose(0, 2, 1) - np.eye(3)).max()
        if off > 1e-6 or (np.linalg.det(every) < 0.0).any():
            raise DataError('geometry: an axis is not given by a rotation')

    @classmethod
    def from_json(cls, parts: Mapping[str, Any]) -> Geometry:
        """
        Return the geometry that `to_json` gave.

        :raises DataError: as the constructor.
        """
        held = tuple(HeldJoint(str(h['name']), float(h['value']), str(h['by']))
                     for h in parts['held'])
        return cls(tuple(map(str, parts['joints'])), parts['rotations'], parts['origins'],
                   str(parts['link']), parts['link_rotation'], held, str(parts['source']))

    def to_json(self) -> dict[str, Any]:
        """Return the geometry as plain lists, for a model file."""
        return {'joints': list(self.joints), 'rotations': self.rotations.tolist(),
                'origins': self.origins.tolist(), 'link': self.link,
                'link_rotation': self.link_rotation.tolist(), 'source': self.source,
                'held': [{'name': h.name, 'value': h.value, 'by': h.by} for h in self.held]}

    @property
    def n_joints(self) -> int:
        return len(self.joints)

    def tool_moments(self) -> FloatArray:
        """
        Return what a tool adds to a chain's moments, shape (4, 2N).

        One row for its mass, in N·m/kg, and one for each component of its first moment in the
        coordinates of `link`, in N·m/(kg m). Each link carries the tool at the end of its own
        length; what lies along an axis acts as a moment of the link before (`chain`).
        """
        n = self.n_joints
        found = np.zeros((4, n, 3))
        found[0, :-1] = self.origins[1:]
        found[1:, -1] = self.link_rotation.T
        for i in range(n - 1, 0, -1):
            found[:, i - 1] += found[:, i, 2:] * self.rotations[i][:, 2]
        return STANDARD_GRAVITY * found[:, :, :2].reshape(4, 2 * n)
