"""Limits of a planned motion: its options, lines that keep them, and admissible poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.planning.collision import SelfCollision
import numpy as np

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# Largest number of recorded poses that are kept, about.
_MAX_POSES = 1500
# Distance between the points at which a line is checked, rad.
_STEP = 0.01
_ROUNDING = 1e-9

_States = tuple[FloatArray, FloatArray, FloatArray]
"""q, qd and qdd, each (M, N)."""


@dataclass(frozen=True)
class PlanOptions:
    """
    Limits of the planned motion.

    `duration` in s bounds the whole motion. `max_speed` (rad/s), `max_acceleration` (rad/s²) and
    `max_jerk` (rad/s³) apply to every joint. Positions stay within `low` and `high` (N,) in rad,
    by default the recorded range, and within `reach` rad of a recorded pose in every joint. The
    motion starts and ends at `start` (N,), by default a recorded pose near the middle. `rate` in
    Hz is that of the trajectory's points.

    :raises OptionError: if a limit is not positive, or the arrays are inconsistent.
    """

    duration: float = 20.0
    max_speed: float = 0.3
    max_acceleration: float = 1.0
    max_jerk: float = 10.0
    reach: float = 0.3
    rate: float = 50.0
    low: FloatArray | None = None
    high: FloatArray | None = None
    start: FloatArray | None = None

    def __post_init__(self) -> None:
        check_positive(self, 'plan', 'duration', 'max_speed', 'max_acceleration', 'max_jerk',
                       'rate')
        if not self.reach > 0.0:
            raise OptionError(f'reach is {self.reach}; it must be positive')
        if (self.low is None) != (self.high is None):
            raise OptionError('give both low and high, or neither')
        if self.low is not None and self.high is not None and (
                self.low.shape != self.high.shape or (self.low > self.high).any()):
            raise OptionError('low must not exceed high')
        if self.start is not None and not np.isfinite(self.start).all():
            raise OptionError('the start pose is not finite')


@dataclass(frozen=True, eq=False)
class Line:
    """
    A straight line in joint space from `start` to `end`, which differ, at rest at both ends.

    The speed rises over T_r as V (1 - cos(pi t / T_r)) / 2, is constant, and falls symmetrically.
    The acceleration is at most pi V / (2 T_r), the jerk at most pi² V / (2 T_r²).
    """

    start: FloatArray
    end: FloatArray
    limits: PlanOptions

    @cached_property
    def _profile(self) -> tuple[float, float]:
        """Return V in 1/s and T_r in s for a line of length 1."""
        length = float(np.abs(self.end - self.start).max())
        speed, bend, jerk = (limit / length for limit in (
            self.limits.max_speed, self.limits.max_acceleration, self.limits.max_jerk))
        # Both ramps together cover V T_r, at most the whole line.
        top = min(speed, np.sqrt(2.0 * bend / np.pi), (np.sqrt(2.0 * jerk) / np.pi) ** (2.0 / 3.0))
        ramp = max(np.pi * top / (2.0 * bend), np.pi * np.sqrt(top / (2.0 * jerk)))
        return float(top), float(ramp)

    @property
    def duration(self) -> float:
        top, ramp = self._profile
        return ramp + max(1.0 / top, ramp)

    def at(self, t: FloatArray) -> _States:
        """Return the states at times (M,) from 0 to the duration."""
        top, ramp = self._profile
        # The second half mirrors the first.
        late = t > 0.5 * self.duration
        x = np.where(late, self.duration - t, t)
        phase = np.pi * np.minimum(x, ramp) / ramp
        s = top * (x - 0.5 * np.minimum(x, ramp) - 0.5 * ramp / np.pi * np.sin(phase))
        v = 0.5 * top * (1.0 - np.cos(phase))
        a = np.where(x < ramp, 0.5 * top * np.pi / ramp * np.sin(phase), 0.0)
        s, a = np.where(late, 1.0 - s, s), np.where(late, -a, a)
        move = self.end - self.start
        return self.start + s[:, None] * move, v[:, None] * move, a[:, None] * move


def through(poses: Sequence[FloatArray], limits: PlanOptions) -> tuple[Line, ...]:
    """Return the lines from each pose to the next one; none between equal poses."""
    return tuple(Line(a, b, limits) for a, b in zip(poses, poses[1:])
                 if np.abs(b - a).max() > 1e-9)


def duration(lines: Sequence[Line]) -> float:
    """Return the duration of lines one after another, s."""
    return sum(line.duration for line in lines)


def sampled(lines: Sequence[Line], rate: float) -> tuple[FloatArray, _States]:
    """
    Return times (M,) in s and q, qd, qdd (M, N) of lines one after another.

    Samples are 1 / rate apart; the last one is at the end, at rest.
    """
    ends = np.cumsum([line.duration for line in lines])
    t = np.arange(int(np.ceil(ends[-1] * rate - 1e-9)) + 1) / rate
    number = np.minimum(np.searchsorted(ends, t, side='right'), len(lines) - 1)
    parts = [line.at(np.minimum(t[number == k] - end + line.duration, line.duration))
             for k, (line, end) in enumerate(zip(lines, ends))]
    q, qd, qdd = (np.concatenate(values) for values in zip(*parts))
    return t, (q, qd, qdd)


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
        from scipy.spatial import cKDTree  # imported here because it takes 0.2 s
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
    for limit in (low, start):
        if limit is not None and limit.shape != (samples.n_joints,):
            raise OptionError(f'{samples.n_joints} joints, but limits or start pose have '
                              f'{limit.size}')
    if start is None:
        inside = poses[((poses >= low) & (poses <= high)).all(axis=1)]
        if not len(inside):
            raise OptionError('no recorded pose lies within the position limits')
        start = inside[np.argmin(np.abs(inside - np.median(inside, axis=0)).max(axis=1))]
    space = Workspace(low, high, poses, options.reach, start, obstacles)
    if not space.admits(start[None]):
        raise OptionError('the start pose is not admissible: it lies outside the position '
                          'limits or too far from every recorded pose')
    if not space.is_clear([start]):
        raise OptionError('at the start pose the arm hits itself, by the collision geometry '
                          'of the description')
    return space
