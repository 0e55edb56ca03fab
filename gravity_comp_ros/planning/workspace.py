"""Where a planned motion may go: within position limits, and near poses that were recorded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.planning.options import PlanOptions
import numpy as np
from scipy.spatial import cKDTree

_MOST_POSES = 1500
# Distance in rad between the points at which a straight line is checked.
_STEP = 0.01
_ROUNDING = 1e-9


class Obstacles(Protocol):
    """What the arm may hit."""

    def hits(self, q: FloatArray) -> bool:
        """Return whether the arm hits something at one of the poses q (M, N)."""


@dataclass(frozen=True, eq=False)
class Workspace:
    """
    Admissible poses: within `low` and `high` (N,), and within `reach` of one of `poses` (P, N).

    The distance of two poses is that of the joint that differs most. `start` is one of them.
    `obstacles` says of poses whether the arm hits something.
    """

    low: FloatArray
    high: FloatArray
    poses: FloatArray
    reach: float
    start: FloatArray
    obstacles: Obstacles | None = None

    @property
    def n_joints(self) -> int:
        return len(self.low)

    def admits(self, q: FloatArray) -> bool:
        """Return whether all poses q (M, N) are admissible."""
        q = np.atleast_2d(q)
        if (q < self.low - _ROUNDING).any() or (q > self.high + _ROUNDING).any():
            return False
        return not np.isfinite(self.reach) or bool(
            (self.distance(q) <= self.reach + _ROUNDING).all())

    def distance(self, q: FloatArray) -> FloatArray:
        """Return how far each pose (M, N) is from the nearest recorded one, (M,) in rad."""
        return np.asarray(self._tree.query(q, p=np.inf)[0])

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.poses)

    def admits_line(self, a: FloatArray, b: FloatArray) -> bool:
        """Return whether the straight line between two poses is admissible."""
        count = 2 + int(np.abs(b - a).max() / _STEP)
        line = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
        return self.admits(line) and self._near(line) and self.is_clear(line)

    def is_clear(self, path: FloatArray) -> bool:
        """Return whether the arm hits nothing on a path (M, N), as far as that can be told."""
        if self.obstacles is None:
            return True
        moved = np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0)
        far = np.concatenate([[0.0], np.cumsum(moved)])
        places = np.linspace(0.0, far[-1], 2 + int(far[-1] / _STEP))
        return not self.obstacles.hits(np.column_stack([np.interp(places, far, q)
                                                        for q in path.T]))

    def admits_path(self, path: FloatArray) -> bool:
        """Return whether a path (M, N) is admissible between its points as well."""
        step = float(np.abs(np.diff(path, axis=0)).max(initial=0.0))
        return self.admits(path) and (not np.isfinite(self.reach) or bool(
            (self.distance(path) <= self.reach - 0.5 * step).all()))

    def _near(self, line: FloatArray) -> bool:
        """
        Return whether a line that was sampled every `_STEP` is near enough between samples too.

        The distance to the nearest recorded pose changes no faster than the pose itself.
        """
        return not np.isfinite(self.reach) or bool(
            (self.distance(line) <= self.reach - 0.5 * _STEP).all())

    def extent(self, pose: FloatArray, direction: FloatArray, most: float) -> float:
        """Return how far, at most `most` in rad, a straight line goes on being admissible."""
        steps = np.arange(1, 1 + int(most / _STEP)) * _STEP
        line = pose + steps[:, None] * direction
        inside = ((line >= self.low - _ROUNDING) & (line <= self.high + _ROUNDING)).all(axis=1)
        if np.isfinite(self.reach) and len(line):
            inside &= self.distance(line) <= self.reach - 0.5 * _STEP
        return float(steps[-1]) if inside.all() and len(steps) else float(
            np.argmin(inside) * _STEP if len(steps) else 0.0)


def workspace(samples: JointSamples, options: PlanOptions,
              obstacles: Obstacles | None = None) -> Workspace:
    """
    Return the workspace that the options allow, from recorded poses.

    :raises OptionError: if the start pose has another number of joints or is not admissible.
    :raises DataError: if there are no samples.
    """
    if not samples.n_samples:
        raise DataError('no samples to plan from')
    poses = samples.q[::-(-samples.n_samples // _MOST_POSES)]
    low = samples.q.min(axis=0) if options.low is None else options.low
    high = samples.q.max(axis=0) if options.high is None else options.high
    start = options.start
    if start is None:
        inside = poses[((poses >= low) & (poses <= high)).all(axis=1)]
        if not len(inside):
            raise OptionError('plan: no recorded pose lies within the position limits')
        start = inside[np.argmin(np.abs(inside - np.median(inside, axis=0)).max(axis=1))]
    if start.shape != (samples.n_joints,) or low.shape != start.shape:
        raise OptionError(f'plan: {samples.n_joints} joints, but limits or start pose have '
                          f'{start.size}')
    found = Workspace(low, high, poses, options.reach, start, obstacles)
    if not found.admits(start):
        raise OptionError('plan: the start pose is not among the poses that the motion may '
                          'reach: it lies outside the limits or far from every recorded pose')
    if not found.is_clear(start[None]):
        raise OptionError('plan: at the start pose the arm hits itself, by the geometry of the '
                          'description')
    return found
