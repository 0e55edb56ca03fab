"""A finer time grid, for disturbances with a memory."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.simulation.motions import Motion
import numpy as np

DEFAULT_STEP = 0.005


@dataclass(frozen=True, eq=False)
class Grid:
    """
    The true motion at K >= M instants, the M samples among them.

    `t` (K,) in s; `q`, `qd` (K, N) in rad and rad/s; `at` (M,) finds the samples.
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    at: IntArray

    def between_samples(self, values: FloatArray) -> FloatArray:
        """Return (K,) values on the grid from (M,) at the samples, by straight lines."""
        if len(self.at) == len(self.t):
            return values
        return np.asarray(np.interp(self.t, self.t[self.at], values))


def fine(motion: Motion, step: float = DEFAULT_STEP) -> Grid:
    """
    Return the motion in steps of at most `step` s.

    :param step: s; samples that lie closer are taken as they are.
    """
    gaps = np.diff(motion.t)
    parts = 1 if gaps.size == 0 else max(1, int(np.ceil(gaps.max() / step - 1e-9)))
    at = parts * np.arange(len(motion.t))
    if parts == 1:
        return Grid(motion.t, motion.q, motion.qd, at)
    inner = motion.t[:-1, None] + gaps[:, None] * np.arange(parts) / parts
    t = np.append(inner.ravel(), motion.t[-1])
    q, qd, _ = motion.path(t)
    return Grid(t, q, qd, at)
