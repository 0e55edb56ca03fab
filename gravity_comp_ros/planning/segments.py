"""
Straight lines in joint space that start and end at rest.

The speed rises over T_r as V (1 - cos(pi t / T_r)) / 2, is constant, and falls symmetrically. The
acceleration is at most pi V / (2 T_r), the jerk at most pi² V / (2 T_r²).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
import numpy as np

_States = tuple[FloatArray, FloatArray, FloatArray]
"""q, qd and qdd, each (M, N)."""


@dataclass(frozen=True)
class Limits:
    """Limits of speed, acceleration and jerk of every joint, in rad and s."""

    speed: float
    acceleration: float
    jerk: float


@dataclass(frozen=True, eq=False)
class Line:
    """A line from `start` to `end`, which differ."""

    start: FloatArray
    end: FloatArray
    limits: Limits

    @cached_property
    def _profile(self) -> tuple[float, float]:
        """Return V in 1/s and T_r in s for a line of length 1."""
        length = float(np.abs(self.end - self.start).max())
        speed, bend, jerk = (limit / length for limit in (
            self.limits.speed, self.limits.acceleration, self.limits.jerk))
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


def through(poses: Sequence[FloatArray], limits: Limits) -> tuple[Line, ...]:
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
