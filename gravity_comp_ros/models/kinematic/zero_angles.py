"""
Zero-angle offsets between encoders and robot description, for an arm with known axes.

A misadjusted encoder zero is about a degree off, and a degree at the elbow changes the torque of
the shoulder by percents. A fit on known axes estimates them (`regression.known_axes`).
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.geometry import Geometry
import numpy as np

# Two axes are parallel up to this difference (1 minus the cosine).
_PARALLEL = 1e-9


def same_axes(geometry: Geometry, other: Geometry) -> bool:
    """Return whether two geometries differ at most in base tilt and zero angles."""
    if geometry.joints != other.joints:
        return False
    cosines = np.einsum('nji,njk->nik', geometry.rotations, other.rotations)[1:, 2, 2]
    return bool((cosines > 1.0 - _PARALLEL).all())


def zero_angle_differences(rotations: FloatArray, others: FloatArray) -> FloatArray:
    """Return the zero angles (N,) in rad of `others` relative to `rotations`; both (N, 3, 3)."""
    relative = rotations.transpose(0, 2, 1) @ others
    return np.asarray(np.arctan2(relative[:, 1, 0], relative[:, 0, 0]))
