"""
Self-collision check of planned poses with the collision geometry of a robot description.

The geometry is computed by Pinocchio and coal. Without them, or without collision geometry, poses
are not checked, and `CollisionsUnchecked` gives the reason. Pairs of links that touch in recorded
poses are excluded: they overlap in the description only. So are neighbours on one joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.samples import evenly_picked, FloatArray
import numpy as np

# Distance below which links count as colliding, m. Points of a path are 0.01 rad apart, and
# between them the arm moves by up to half of that times its length.
MARGIN = 0.01
# Number of recorded poses that are checked for overlapping links.
_MAX_RECORDED = 400


class CollisionsUnchecked(Exception):
    """Collisions cannot be checked; the text gives the reason."""


@dataclass(frozen=True, eq=False)
class SelfCollision:
    """
    Pairs of links of an arm that may collide.

    `joints` (N,) are the joints of Pinocchio in the order of poses; all others are at `rest`.
    `overlapping` names the excluded pairs, which touch in recorded poses.
    """

    model: Any
    geometry: Any
    joints: tuple[Any, ...]
    rest: FloatArray
    overlapping: tuple[str, ...]

    def hits(self, q: FloatArray) -> bool:
        """Return whether links collide at one of the poses q (M, N)."""
        return self.first_hit(q) is not None

    def first_hit(self, q: FloatArray) -> tuple[int, str] | None:
        """Return the number of the first pose with a collision, and the names of the links."""
        import pinocchio as pin
        data, geometry_data = self.model.createData(), _geometry_data(self.geometry)
        for number, pose in enumerate(np.atleast_2d(q)):
            if pin.computeCollisions(self.model, data, self.geometry, geometry_data,
                                     self.configuration(pose), True):
                pair = next(pair for pair, result in zip(
                    self.geometry.collisionPairs, geometry_data.collisionResults)
                    if result.isCollision())
                return number, _pair_name(self.geometry, pair)
        return None

    def configuration(self, pose: FloatArray) -> FloatArray:
        """Return the configuration of Pinocchio at a pose (N,)."""
        configuration = self.rest.copy()
        for joint, angle in zip(self.joints, pose):
            # Pinocchio represents a continuous joint by its cosine and sine.
            configuration[joint.idx_q:joint.idx_q + joint.nq] = (
                angle if joint.nq == 1 else (np.cos(angle), np.sin(angle)))
        return configuration


def self_collision(urdf: str, joints: Sequence[str], recorded: FloatArray,
                   folder: Path | None = None) -> SelfCollision:
    """
    Return the self-collision check of a description.

    :param urdf: the text of the description. :param joints: N names, in the order of poses.
    :param recorded: recorded poses (M, N).
    :param folder: the folder of the description; meshes are searched in it and its parents.
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
    geometry.addAllCollisionPairs()
    moving = tuple(model.joints[model.getJointId(joint)] for joint in joints)
    check = SelfCollision(model, geometry, moving, pin.neutral(model), ())
    return replace(check, overlapping=_remove_pairs(
        check, recorded[evenly_picked(len(recorded), _MAX_RECORDED)]))


def collision_check(urdf: Path | None, joints: Sequence[str],
                    recorded: FloatArray) -> tuple[SelfCollision | None, str]:
    """Return the self-collision check of a file, if possible, and a message about it."""
    if urdf is None:
        return None, ('not checked whether the links of the arm hit each other: this requires a '
                      'description with collision geometry (--urdf)')
    from gravity_comp_ros.description.urdf import read_text
    text = read_text(urdf).decode('utf-8', 'replace')
    try:
        check = self_collision(text, joints, recorded, urdf.resolve().parent)
    except CollisionsUnchecked as problem:
        return None, f'not checked whether the links of the arm hit each other: {problem}'
    excluded = (f'; {", ".join(check.overlapping)} overlap in recorded poses and are excluded'
                if check.overlapping else '')
    return check, (f'the links of the arm stay {MARGIN:g} m apart by the collision geometry of '
                   f'{urdf.name}{excluded}')


def _remove_pairs(check: SelfCollision, recorded: FloatArray) -> tuple[str, ...]:
    """Remove neighbours, and pairs that touch in recorded poses (M, N); return these."""
    import pinocchio as pin
    model, geometry = check.model, check.geometry
    for pair in list(geometry.collisionPairs):
        one, other = (geometry.geometryObjects[k].parentJoint for k in (pair.first, pair.second))
        if model.parents[other] == one or model.parents[one] == other:
            geometry.removeCollisionPair(pair)
    data, geometry_data, pairs = model.createData(), _geometry_data(geometry), list(
        geometry.collisionPairs)
    touching: set[int] = set()
    for pose in recorded:
        pin.computeCollisions(model, data, geometry, geometry_data, check.configuration(pose),
                              False)
        touching.update(k for k, result in enumerate(geometry_data.collisionResults)
                        if result.isCollision())
    for k in touching:
        geometry.removeCollisionPair(pairs[k])
    return tuple(_pair_name(geometry, pairs[k]) for k in sorted(touching))


def _geometry_data(geometry: Any) -> Any:
    data = geometry.createData()
    for request in data.collisionRequests:
        request.security_margin = MARGIN
    return data


def _pair_name(geometry: Any, pair: Any) -> str:
    one, other = (geometry.geometryObjects[k].name for k in (pair.first, pair.second))
    return f'{one} and {other}'
