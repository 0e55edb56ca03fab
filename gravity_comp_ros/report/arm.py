"""Geometry of the arm for drawings, from a robot description."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from pathlib import Path

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.description.robot_tree import position_limits
from gravity_comp_ros.description.urdf import parse_urdf, read_text
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.recordings.robot_description import first_description
import numpy as np
from scipy.spatial.distance import cdist

# Maximum joint range of a drawing, in rad from zero.
_MAX_ANGLE = math.pi
_RANDOM_POSES, _MAX_VISITED = 2000, 500


@dataclass(frozen=True, eq=False)
class Arm:
    """Joint axes and joint limits (N,) in rad, in the order of the axes."""

    geometry: Geometry
    low: FloatArray
    high: FloatArray

    @property
    def reach(self) -> float:
        """Return the length of the stretched arm in m."""
        return max(float(np.linalg.norm(self.geometry.origins, axis=1).sum()), 1e-3)


def find_arm(paths: Sequence[Path], joints: Sequence[str], urdf: Path | None = None) -> Arm | None:
    """
    Return the arm of these joints, from a file or from the description in the recordings.

    Return None if the recordings have no description, or one of another robot.

    :param urdf: robot description to use instead of that of the recordings.
    :raises DataError: if this file is missing or not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    """
    if urdf is not None:
        return described_arm(read_text(urdf), joints)
    try:
        description = first_description(paths)
        return None if description is None else described_arm(description.text, joints)
    except GravityCompError:
        return None


def described_arm(text: str | bytes, joints: Sequence[str]) -> Arm:
    """
    Return the arm of these joints.

    :raises DataError: if the text is not a URDF.
    :raises ModelMismatchError: if it describes another arm.
    """
    geometry = parse_urdf(text, joints)
    low, high = position_limits(text, geometry.joints)
    return Arm(geometry, low.clip(-_MAX_ANGLE, _MAX_ANGLE), high.clip(-_MAX_ANGLE, _MAX_ANGLE))


def unvisited_poses(q: FloatArray, low: FloatArray, high: FloatArray, count: int) -> FloatArray:
    """
    Return poses (count, N) within the limits, far from all poses q (M, N) and from each other.

    Distances are relative to the range of each joint.
    """
    rng = np.random.default_rng(0)
    width = np.maximum(high - low, 1e-3)
    candidates = rng.uniform(0.0, 1.0, (_RANDOM_POSES, len(low)))
    visited = (q[::max(1, len(q) // _MAX_VISITED)] - low) / width
    distance = cdist(candidates, visited).min(axis=1)
    poses = np.zeros((count, len(low)))
    for pose in poses:
        pose[:] = candidates[distance.argmax()]
        distance = np.minimum(distance, np.linalg.norm(candidates - pose, axis=1))
    return low + width * poses
