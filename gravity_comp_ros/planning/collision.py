"""
Self-collision check of planned poses with the collision geometry of a robot description.

The geometry is computed by Pinocchio and coal. Without them, or without collision geometry, poses
are not checked, and `CollisionsUnchecked` gives the reason. Pairs of links that touch in recorded
poses are excluded: they overlap in the description only. So are neighbours on one joint.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gravity_comp_ros.data.samples import evenly_picked, FloatArray
from gravity_comp_ros.errors import GravityCompError
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
        return any(self.colliding(q, True))

    def colliding(self, q: FloatArray, is_one_enough: bool = False) -> Iterator[list[int]]:
        """Yield the numbers of the pairs that collide at each of the poses q (M, N)."""
        import pinocchio as pin
        data, geometry_data = self.model.createData(), self.geometry.createData()
        for request in geometry_data.collisionRequests:
            request.security_margin = MARGIN
        for pose in np.atleast_2d(q):
            pin.computeCollisions(self.model, data, self.geometry, geometry_data,
                                  self.configuration(pose), is_one_enough)
            yield [k for k, result in enumerate(geometry_data.collisionResults)
                   if result.isCollision()]

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
        model = pin.buildModelFromXML(urdf)
        geometry = pin.buildGeomFromUrdfString(
            model, urdf, pin.GeometryType.COLLISION,
            package_dirs=[] if folder is None else [str(f) for f in (folder, *folder.parents)])
    except ImportError:
        raise CollisionsUnchecked('pinocchio is not installed (pip install pin)') from None
    except (ValueError, RuntimeError) as problem:
        raise CollisionsUnchecked(' '.join(str(problem).split())) from None
    missing = [joint for joint in joints if not model.existJointName(joint)]
    if geometry.ngeoms < 2 or missing:
        raise CollisionsUnchecked(
            'the description has no collision geometry' if geometry.ngeoms < 2 else
            f'the description has no moving joint {", ".join(missing)}')
    geometry.addAllCollisionPairs()
    moving = tuple(model.joints[model.getJointId(joint)] for joint in joints)
    check = SelfCollision(model, geometry, moving, pin.neutral(model), ())
    return replace(check, overlapping=_remove_pairs(
        check, recorded[evenly_picked(len(recorded), _MAX_RECORDED)]))


@dataclass(frozen=True, eq=False)
class ArmLimits:
    """
    Position limits (N,) in rad and self-collision check of a description.

    `positions` and `check` are None where they are unknown; `note` is about the check.
    """

    positions: tuple[FloatArray, FloatArray] | None
    check: SelfCollision | None
    note: str


def arm_limits(urdf: Path | str | None, recordings: Collection[Path], joints: Sequence[str],
               recorded: FloatArray) -> ArmLimits:
    """
    Return the limits of the description in a file, else of that in the recordings.

    One in the recordings that does not match the joints is not used; the note gives the reason.

    :param recorded: recorded poses (M, N) in rad.
    :raises DataError: if the file is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    """
    # Imports the XML parser.
    from gravity_comp_ros.description.robot_tree import find_description
    positions = None
    try:
        description = find_description(urdf, recordings)
        if description is None:
            raise CollisionsUnchecked('this requires a description with collision geometry '
                                      '(--urdf)')
        text, source = description.text, description.source
        positions = description.position_limits(joints)
        check = self_collision(text if isinstance(text, str) else text.decode('utf-8', 'replace'),
                               joints, recorded, description.folder)
    except (CollisionsUnchecked, GravityCompError) as problem:
        if urdf is not None and isinstance(problem, GravityCompError):
            raise
        return ArmLimits(positions, None, f'not checked whether the links of the arm hit each '
                                          f'other: {problem}')
    excluded = (f'; {", ".join(check.overlapping)} overlap in recorded poses and are excluded'
                if check.overlapping else '')
    return ArmLimits(positions, check, f'the links of the arm stay {MARGIN:g} m apart by the '
                                       f'collision geometry of {source}{excluded}')


def _remove_pairs(check: SelfCollision, recorded: FloatArray) -> tuple[str, ...]:
    """Remove neighbours, and pairs that touch in recorded poses (M, N); return these."""
    geometry, parents = check.geometry, check.model.parents
    for pair in list(geometry.collisionPairs):
        one, other = (geometry.geometryObjects[k].parentJoint for k in (pair.first, pair.second))
        if parents[other] == one or parents[one] == other:
            geometry.removeCollisionPair(pair)
    pairs, names = list(geometry.collisionPairs), []
    for k in sorted({k for touching in check.colliding(recorded) for k in touching}):
        geometry.removeCollisionPair(pairs[k])
        names.append(' and '.join(geometry.geometryObjects[n].name
                                  for n in (pairs[k].first, pairs[k].second)))
    return tuple(names)
