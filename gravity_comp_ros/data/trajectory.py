"""Joint trajectory, sampled in time."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import DataError
import numpy as np


@dataclass(frozen=True, eq=False)
class Trajectory:
    """
    Points of a motion: `t` (M,) in s from 0, `q`, `qd`, `qdd` (M, N) in rad, rad/s, rad/s².

    `effort` (M, N) in N·m is the feed-forward torque, None without one.

    :raises DataError: if shapes disagree, a number is not finite, or time does not increase.
    """

    joints: tuple[str, ...]
    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    effort: FloatArray | None = None

    def __post_init__(self) -> None:
        shape = (len(self.t), len(self.joints))
        for name in ('q', 'qd', 'qdd', 'effort'):
            values = getattr(self, name)
            if values is not None and (values.shape != shape or not np.isfinite(values).all()):
                raise DataError(f'trajectory: {name} has shape {values.shape} or contains a '
                                f'number that is not finite; expected {shape}')
        if len(self.t) < 2 or not np.isfinite(self.t).all() or (np.diff(self.t) <= 0.0).any():
            raise DataError('trajectory: at least two points with increasing times are required')

    @property
    def duration(self) -> float:
        return float(self.t[-1] - self.t[0])

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, qd, qdd at other times: quintic between the points, at rest beyond them."""
        t = np.asarray(t, dtype=np.float64)
        inside = np.clip(t, self.t[0], self.t[-1])
        k = np.clip(np.searchsorted(self.t, inside, side='right') - 1, 0, len(self.t) - 2)
        h = (self.t[k + 1] - self.t[k])[:, None]
        x = (inside - self.t[k])[:, None] / h
        a = _quintic(self.q[k], self.q[k + 1], h * self.qd[k], h * self.qd[k + 1],
                     h ** 2 * self.qdd[k], h ** 2 * self.qdd[k + 1])
        q = sum(c * x ** n for n, c in enumerate(a))
        qd = sum(n * c * x ** (n - 1) for n, c in enumerate(a) if n) / h
        qdd = sum(n * (n - 1) * c * x ** (n - 2) for n, c in enumerate(a) if n > 1) / h ** 2
        moving = ((t >= self.t[0]) & (t <= self.t[-1]))[:, None]
        return np.asarray(q), np.where(moving, qd, 0.0), np.where(moving, qdd, 0.0)


def _quintic(p0: FloatArray, p1: FloatArray, v0: FloatArray, v1: FloatArray, a0: FloatArray,
             a1: FloatArray) -> tuple[FloatArray, ...]:
    """Return the coefficients of the quintic polynomial over 0 to 1 with these end conditions."""
    d, dv, da = p1 - p0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    return (p0, v0, 0.5 * a0, 10.0 * d - 4.0 * dv + 0.5 * da, -15.0 * d + 7.0 * dv - da,
            6.0 * d - 3.0 * dv + 0.5 * da)
