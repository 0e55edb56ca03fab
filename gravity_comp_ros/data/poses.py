"""Poses at which torques are compared, and batches of poses."""

from __future__ import annotations

from collections.abc import Iterator

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

# Number of poses: the RMS of a torque over them is that over the box to about 5 %.
_POSES = 200
# Number of poses of a batch: their columns fit into the processor's cache, and the memory does not
# grow with the length of a recording.
_AT_ONCE = 2048


def random_poses(n_joints: int, low: FloatArray | float = -np.pi,
                 high: FloatArray | float = np.pi, count: int = _POSES) -> FloatArray:
    """Return random poses (P, N) in rad, the same at every call, between limits (N,) in rad."""
    return np.random.default_rng(0).uniform(low, high, (count, n_joints))


def batches(count: int) -> Iterator[slice]:
    """Yield slices of a number of poses; one without poses if there are none."""
    for start in range(0, max(count, 1), _AT_ONCE):
        yield slice(start, start + _AT_ONCE)
