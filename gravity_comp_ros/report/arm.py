"""The arm that a recording is of, where a robot description says what it looks like."""

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

# A joint's range for a drawing ends after a turn either way.
_WIDEST = math.pi
_DRAWN_POSES, _MOST_VISITED = 2000, 500


@dataclass(frozen=True, eq=False)
class Arm:
    """Where the axes are, and the limits of the joints (N,) in rad, in the order of the axes."""

    geometry: Geometry
    low: FloatArray
    high: FloatArray

    @property
    def reach(self) -> float:
        """Return the length of the arm in m when it is stretched out."""
        return max(float(np.linalg.norm(self.geometry.origins, axis=1).sum()), 1e-3)


def find_arm(paths: Sequence[Path], joints: Sequence[str], urdf: Path | None = None) -> Arm | None:
    """
    Return the arm of these joints, from a file or from what the recordings hold.

    Without a description, or with one of another robot, there is none.

    :param urdf: a robot description, instead of the recordings' own.
    """
    try:
        if urdf is not None:
            return described_arm(read_text(urdf), joints)
        found = first_description(paths)
        return None if found is None else described_arm(found.text, joints)
    except GravityCompError:
        return None


def described_arm(text: str | bytes, joints: Sequence[str]) -> Arm:
    """
    Return the arm of these joints.

    :raises DataError: if the text is no URDF.
    :raises ModelMismatchError: if it is of another arm.
    """
    geometry = parse_urdf(text, joints)
    low, high = position_limits(text, geometry.joints)
    return Arm(geometry, low.clip(-_WIDEST, _WIDEST), high.clip(-_WIDEST, _WIDEST))


def unvisited_poses(q: FloatArray, low: FloatArray, high: FloatArray, count: int) -> FloatArray:
    """
    Return poses (count, N) within the limits, each far from all poses q (M, N) and the others.

    Distances are in shares of each joint's range.
    """
    rng = np.random.default_rng(0)
    width = np.maximum(high - low, 1e-3)
    drawn = rng.uniform(0.0, 1.0, (_DRAWN_POSES, len(low)))
    visited = (q[::max(1, len(q) // _MOST_VISITED)] - low) / width
    nearest = np.full(len(drawn), np.inf)
    for pose in visited:
        nearest = np.minimum(nearest, np.linalg.norm(drawn - pose, axis=1))
    found = []
    for _ in range(count):
        place = int(nearest.argmax())
        found.append(low + width * drawn[place])
        nearest = np.minimum(nearest, np.linalg.norm(drawn - drawn[place], axis=1))
    return np.array(found)
