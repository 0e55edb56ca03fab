"""Fine time grid for disturbances with a state."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.simulation.motions import Motion
import numpy as np

# Largest integration step, s.
_STEP = 0.005


@dataclass(frozen=True, eq=False)
class Grid:
    """
    The true motion at K >= M instants, which include the M samples.

    `t` (K,) in s; `q`, `qd` (K, N) in rad and rad/s; `at` (M,) are the indices of the samples.
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    at: IntArray

    def between_samples(self, values: FloatArray) -> FloatArray:
        """Return values (K,) on the grid by linear interpolation of values (M,) at the samples."""
        if len(self.at) == len(self.t):
            return values
        return np.asarray(np.interp(self.t, self.t[self.at], values))


def fine_grid(motion: Motion, step: float = _STEP) -> Grid:
    """Return the motion in steps of at most `step` s; closer samples are kept unchanged."""
    gaps = np.diff(motion.t)
    parts = 1 if gaps.size == 0 else max(1, int(np.ceil(gaps.max() / step - 1e-9)))
    at = parts * np.arange(len(motion.t))
    if parts == 1:
        return Grid(motion.t, motion.q, motion.qd, at)
    inner = motion.t[:-1, None] + gaps[:, None] * np.arange(parts) / parts
    t = np.append(inner.ravel(), motion.t[-1])
    q, qd, _ = motion.path(t)
    return Grid(t, q, qd, at)
