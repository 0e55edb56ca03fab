"""Admissible poses of a planned motion: position limits and distance to recorded poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.planning.collision import SelfCollision
from gravity_comp_ros.planning.options import PlanOptions
import numpy as np
from scipy.spatial import cKDTree

# Largest number of recorded poses that are kept, about.
_MAX_POSES = 1500
# Distance between the points at which a line is checked, rad.
_STEP = 0.01
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Workspace:
    """
    Admissible poses: within `low` and `high` (N,), and within `reach` of one of `poses` (P, N).

    The distance of two poses is the largest difference of a joint. The motion starts and ends at
    `start`. `obstacles` checks poses for collisions.
    """

    low: FloatArray
    high: FloatArray
    poses: FloatArray
    reach: float
    start: FloatArray
    obstacles: SelfCollision | None = None

    def inside(self, q: FloatArray, margin: float = 0.0) -> BoolArray:
        """Return a mask (M,) of admissible poses q (M, N), with a margin in rad."""
        inside = ((q >= self.low - _ROUNDING) & (q <= self.high + _ROUNDING)).all(axis=1)
        if np.isfinite(self.reach):
            # The distance to the nearest recorded pose changes no faster than the pose itself.
            inside &= self._tree.query(q, p=np.inf)[0] <= self.reach + _ROUNDING - margin
        return np.asarray(inside)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.poses)

    def admits(self, q: FloatArray) -> bool:
        """Return whether all poses q (M, N) are admissible."""
        return bool(self.inside(q).all())

    def admits_line(self, a: FloatArray, b: FloatArray) -> bool:
        """Return whether the straight line between two poses is admissible and clear."""
        count = 2 + int(np.abs(b - a).max() / _STEP)
        line = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
        return bool(self.inside(line, 0.5 * _STEP).all()) and self.is_clear([a, b])

    def is_clear(self, poses: Sequence[FloatArray]) -> bool:
        """Return whether the lines through poses are free of collisions; True without a check."""
        if self.obstacles is None:
            return True
        moved = np.abs(np.diff(poses, axis=0)).max(axis=1, initial=0.0)
        length = np.concatenate([[0.0], np.cumsum(moved)])
        points = np.linspace(0.0, length[-1], 2 + int(length[-1] / _STEP))
        return not self.obstacles.hits(np.column_stack([np.interp(points, length, q)
                                                        for q in np.transpose(poses)]))

    def extent(self, pose: FloatArray, direction: FloatArray, limit: float) -> float:
        """Return the length, at most `limit`, of the admissible line from a pose, rad."""
        steps = np.arange(1 + int(limit / _STEP)) * _STEP
        inside = self.inside(pose + steps[:, None] * direction, 0.5 * _STEP)
        inside[0] = True
        return float(steps[-1] if inside.all() else steps[np.argmin(inside) - 1])


def workspace(samples: JointSamples, options: PlanOptions,
              obstacles: SelfCollision | None = None) -> Workspace:
    """
    Return the workspace of the options and the recorded poses.

    :raises OptionError: if the start pose has the wrong number of joints or is not admissible.
    :raises DataError: if there are no samples.
    """
    if not samples.n_samples:
        raise DataError('no samples to plan from')
    poses = samples.q[::-(-samples.n_samples // _MAX_POSES)]
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
    space = Workspace(low, high, poses, options.reach, start, obstacles)
    if not space.admits(start[None]):
        raise OptionError('plan: the start pose is not admissible: it lies outside the position '
                          'limits or too far from every recorded pose')
    if not space.is_clear([start]):
        raise OptionError('plan: at the start pose the arm hits itself, by the collision geometry '
                          'of the description')
    return space
