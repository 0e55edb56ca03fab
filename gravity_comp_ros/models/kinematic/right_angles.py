"""Right angles between joint axes, which an update after a payload change leaves as they are."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

# Standard deviation of a machined and zeroed right angle, in rad.
TOLERANCE = 1e-3
# An angle is an adopted right angle if its std is below this multiple of the tolerance.
_ADOPTED = 1.5


def right_angles_kept(mean: FloatArray, covariance: FloatArray, before: FloatArray) -> FloatArray:
    """
    Return the mean of a step (K,), first angles (2N,), given that right angles stay right.

    :param covariance: of the step, (K, K).
    :param before: the covariance (K, K) before the new data; angles with a standard deviation near
        the tolerance are right angles.
    """
    half = len(mean) // 2
    spread = np.sqrt(np.maximum(np.diag(before)[:half], 0.0))
    adopted = np.flatnonzero((spread > 0.0) & (spread < _ADOPTED * TOLERANCE))
    shift = np.linalg.pinv(covariance[np.ix_(adopted, adopted)], hermitian=True) @ mean[adopted]
    kept = mean - covariance[:, adopted] @ shift
    kept[adopted] = 0.0
    return np.asarray(kept)
