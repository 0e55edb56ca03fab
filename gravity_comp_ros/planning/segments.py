"""
Segments of motion that start and end at rest, within limits of speed, acceleration and jerk.

The speed of a straight line rises over T_r as V (1 - cos(pi t / T_r)) / 2, is constant, and falls
symmetrically. The acceleration is at most pi V / (2 T_r), the jerk at most pi² V / (2 T_r²).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

_Path = tuple[FloatArray, FloatArray, FloatArray]
"""q, qd and qdd, each (M, N), at times from 0 to the duration of a segment."""


@dataclass(frozen=True)
class Limits:
    """Limits of speed, acceleration and jerk of every joint, in rad and s."""

    speed: float
    acceleration: float
    jerk: float

    def slower(self, speed: float) -> Limits:
        return Limits(min(self.speed, speed), self.acceleration, self.jerk)


@dataclass(frozen=True, eq=False)
class Hold:
    """Rest at a pose."""

    pose: FloatArray
    duration: float

    @property
    def end(self) -> FloatArray:
        return self.pose

    def at(self, t: FloatArray) -> _Path:
        q = np.broadcast_to(self.pose, (len(t), len(self.pose))).copy()
        return q, np.zeros_like(q), np.zeros_like(q)


@dataclass(frozen=True, eq=False)
class Line:
    """A straight line in joint space from `start` to `end`."""

    start: FloatArray
    end: FloatArray
    limits: Limits

    @cached_property
    def _profile(self) -> tuple[float, float, float]:
        """Return V in 1/s, T_r and the time of constant speed in s, for a line of length 1."""
        length = float(np.abs(self.end - self.start).max())
        if length < 1e-12:
            return 0.0, 0.0, 0.0
        speed, bend, jerk = (limit / length for limit in (
            self.limits.speed, self.limits.acceleration, self.limits.jerk))
        # Both ramps together cover V T_r, at most the whole line.
        top = min(speed, np.sqrt(2.0 * bend / np.pi), (np.sqrt(2.0 * jerk) / np.pi) ** (2.0 / 3.0))
        ramp = max(np.pi * top / (2.0 * bend), np.pi * np.sqrt(top / (2.0 * jerk)))
        return float(top), float(ramp), float(max(0.0, 1.0 - top * ramp) / top)

    @property
    def duration(self) -> float:
        return 2.0 * self._profile[1] + self._profile[2]

    def at(self, t: FloatArray) -> _Path:
        top, ramp, cruise = self._profile
        move = self.end - self.start
        if not top:
            return Hold(self.end, 0.0).at(t)
        t = np.clip(t, 0.0, self.duration)
        # The second half mirrors the first.
        late = t > 0.5 * self.duration
        x = np.where(late, self.duration - t, t)
        in_ramp = x < ramp
        phase = np.pi * np.minimum(x, ramp) / ramp
        s = np.where(in_ramp, 0.5 * top * (x - ramp / np.pi * np.sin(phase)),
                     0.5 * top * ramp + top * (x - ramp))
        v = np.where(in_ramp, 0.5 * top * (1.0 - np.cos(phase)), top)
        a = np.where(in_ramp, 0.5 * top * np.pi / ramp * np.sin(phase), 0.0)
        s, a = np.where(late, 1.0 - s, s), np.where(late, -a, a)
        return self.start + s[:, None] * move, v[:, None] * move, a[:, None] * move


Segment = Hold | Line


def sampled(segments: Sequence[Segment], rate: float) -> tuple[FloatArray, _Path]:
    """
    Return times (M,) in s and q, qd, qdd (M, N) of segments one after another.

    Samples are 1 / rate apart; the last one is at the end, at rest.
    """
    ends = np.cumsum([segment.duration for segment in segments])
    count = int(np.ceil(ends[-1] * rate - 1e-9)) + 1
    t = np.arange(count) / rate
    number = np.minimum(np.searchsorted(ends, t, side='right'), len(segments) - 1)
    n = len(segments[0].end)
    q, qd, qdd = (np.empty((count, n)) for _ in range(3))
    for k, segment in enumerate(segments):
        here = number == k
        if here.any():
            start = ends[k] - segment.duration
            q[here], qd[here], qdd[here] = segment.at(
                np.minimum(t[here] - start, segment.duration))
    return t, (q, qd, qdd)
