"""
Whether the links of an arm hit each other, by the collision geometry of its description.

Pinocchio and coal do the geometry; without them, or without geometry, nothing is checked, and
`CollisionsUnchecked` says why. Links that touch in recorded poses overlap in the description only:
the arm was there. Neighbours on a joint always may touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.samples import evenly_picked, FloatArray
import numpy as np

# Links that come as near as this hit each other, m: points of a path are a hundredth of a radian
# apart, and the arm moves by up to half of that times its length beside them.
MARGIN = 0.01
_RECORDED = 400


class CollisionsUnchecked(Exception):
    """Collisions cannot be checked; the text says why."""


@dataclass(frozen=True, eq=False)
class SelfCollision:
    """
    The pairs of links of an arm that may hit each other.

    `joints` (N,) are the joints of Pinocchio in the order of poses; all others are at `rest`.
    `overlapping` names pairs that are left out, since they touch in recorded poses.
    """

    model: Any
    geometry: Any
    joints: tuple[Any, ...]
    rest: FloatArray
    overlapping: tuple[str, ...]

    def hits(self, q: FloatArray) -> bool:
        """Return whether links hit each other at one of the poses q (M, N)."""
        return self.first_hit(q) is not None

    def first_hit(self, q: FloatArray) -> tuple[int, str] | None:
        """Return the number of the first pose at which links hit, and their names."""
        import pinocchio as pin
        data, about = self.model.createData(), _data(self.geometry)
        for number, pose in enumerate(np.atleast_2d(q)):
            if pin.computeCollisions(self.model, data, self.geometry, about,
                                     self._configuration(pose), True):
                return number, self._names(about)
        return None

    def _names(self, about: Any) -> str:
        return next(_pair(self.geometry, pair) for pair, result in zip(
            self.geometry.collisionPairs, about.collisionResults) if result.isCollision())

    def _configuration(self, pose: FloatArray) -> FloatArray:
        found = self.rest.copy()
        for joint, angle in zip(self.joints, pose):
            # A continuous joint is a cosine and a sine.
            found[joint.idx_q:joint.idx_q + joint.nq] = (
                angle if joint.nq == 1 else (np.cos(angle), np.sin(angle)))
        return found


def self_collision(urdf: str, joints: Sequence[str], recorded: FloatArray,
                   folder: Path | None = None) -> SelfCollision:
    """
    Return the check of a description's collision geometry.

    :param urdf: the text of the description. :param joints: N names, in the order of poses.
    :param recorded: poses (M, N) at which the arm has been.
    :param folder: where the description lies; meshes are sought beside it and above.
    :raises CollisionsUnchecked: if Pinocchio, a joint, geometry or a mesh is missing.
    """
    try:
        import pinocchio as pin
    except ImportError:
        raise CollisionsUnchecked('pinocchio is not installed (pip install pin)') from None
    folders = [str(f) for f in (folder, *folder.parents)] if folder is not None else []
    try:
        model = pin.buildModelFromXML(urdf)
        geometry = pin.buildGeomFromUrdfString(model, urdf, pin.GeometryType.COLLISION,
                                               package_dirs=folders)
    except (ValueError, RuntimeError) as problem:
        raise CollisionsUnchecked(' '.join(str(problem).split())) from None
    if geometry.ngeoms < 2:
        raise CollisionsUnchecked('the description has no collision geometry')
    missing = [joint for joint in joints if not model.existJointName(joint)]
    if missing:
        raise CollisionsUnchecked(f'the description has no moving joint {", ".join(missing)}')
    _add_pairs(model, geometry)
    moving = tuple(model.joints[model.getJointId(joint)] for joint in joints)
    whole = SelfCollision(model, geometry, moving, pin.neutral(model), ())
    return _without_overlaps(whole, recorded[evenly_picked(len(recorded), _RECORDED)])


def collision_check(urdf: Path | None, joints: Sequence[str],
                    recorded: FloatArray) -> tuple[SelfCollision | None, str]:
    """Return the check that a file allows, if any, and a line on what is checked."""
    if urdf is None:
        return None, ('not checked whether the links of the arm hit each other: a description '
                      'with collision geometry (--urdf) would tell')
    from gravity_comp_ros.description.urdf import read_text
    text = read_text(urdf).decode('utf-8', 'replace')
    try:
        found = self_collision(text, joints, recorded, urdf.resolve().parent)
    except CollisionsUnchecked as problem:
        return None, f'not checked whether the links of the arm hit each other: {problem}'
    left_out = (f'; {", ".join(found.overlapping)} overlap in recorded poses and are left out'
                if found.overlapping else '')
    return found, (f'the links of the arm stay {MARGIN:g} m apart by the collision geometry of '
                   f'{urdf.name}{left_out}')


def _add_pairs(model: Any, geometry: Any) -> None:
    """Add all pairs of links but those on one joint and neighbours."""
    import pinocchio as pin
    parents = [obj.parentJoint for obj in geometry.geometryObjects]
    for a, one in enumerate(parents):
        for b in range(a + 1, len(parents)):
            other = parents[b]
            if one != other and model.parents[other] != one and model.parents[one] != other:
                geometry.addCollisionPair(pin.CollisionPair(a, b))


def _without_overlaps(check: SelfCollision, recorded: FloatArray) -> SelfCollision:
    import pinocchio as pin
    data, about = check.model.createData(), _data(check.geometry)
    touching: set[int] = set()
    for pose in recorded:
        pin.computeCollisions(check.model, data, check.geometry, about,
                              check._configuration(pose), False)
        touching.update(k for k, result in enumerate(about.collisionResults)
                        if result.isCollision())
    pairs = list(check.geometry.collisionPairs)
    names = tuple(_pair(check.geometry, pairs[k]) for k in sorted(touching))
    for k in sorted(touching):
        check.geometry.removeCollisionPair(pairs[k])
    return SelfCollision(check.model, check.geometry, check.joints, check.rest, names)


def _data(geometry: Any) -> Any:
    about = geometry.createData()
    for request in about.collisionRequests:
        request.security_margin = MARGIN
    return about


def _pair(geometry: Any, pair: Any) -> str:
    one, other = (geometry.geometryObjects[k].name for k in (pair.first, pair.second))
    return f'{one} and {other}'
