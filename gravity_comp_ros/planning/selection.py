"""
Candidate parts of a planned motion, and their selection: greedy by utility per time.

A part is a tour of straight lines through poses. It starts and ends at rest at one pose, its base.
Strokes go back and forth along one joint, or along several in drawn directions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import groupby

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.criterion import Criterion
from gravity_comp_ros.planning.workspace import (
    duration, Line, PlanOptions, through, Workspace)
import numpy as np

# Duration of strokes as a share of that of the motion, and at most in s: several short ones are
# better than a long one. Strokes through the whole range of a joint may take all of it.
_SHARE, _MAX_SECONDS = 0.25, 8.0
# Shortest stroke and largest search distance, rad.
_MIN_STROKE, _MAX_STROKE = 0.02, 3.0
# Number of drawn directions of several joints from each base.
_TOGETHER = 2
# Smallest gain in utility that counts.
_MIN_GAIN = 0.02


@dataclass(frozen=True, eq=False)
class Part:
    """
    A tour from a base, the first of `stops`, back to it; `what` describes it.

    `lines` connect the stops; `way` has those from the start of the whole motion to the base.
    """

    what: str
    joints: tuple[int, ...]
    stops: Sequence[FloatArray]
    lines: tuple[Line, ...]
    way: tuple[Line, ...]

    @cached_property
    def duration(self) -> float:
        return duration(self.lines)


def strokes(space: Workspace, model: GravityModel, joints: Sequence[int],
            options: PlanOptions) -> list[Part]:
    """Return parts that move one of some joints, or all at once."""
    rng, parts = np.random.default_rng(0), []
    for joint in joints:
        for posture, base in _bases(space, model, joint):
            way = through([space.start, base], options)
            axes = [np.eye(len(base))[joint]]
            for _ in range(_TOGETHER * (len(joints) > 1)):
                axes.append(np.zeros(len(base)))
                axes[-1][list(joints)] = rng.choice([-1.0, 1.0], len(joints))
            parts += [Part(what + posture, tuple(np.flatnonzero(axis).tolist()), stops,
                           through(stops, options), way) for axis in axes
                      for what, stops in _along(space, base, axis, options)]
    return parts


def _along(space: Workspace, base: FloatArray, axis: FloatArray,
           options: PlanOptions) -> Iterator[tuple[str, list[FloatArray]]]:
    """Yield strokes along an axis about a base, and over all of the axis that is admitted."""
    up, down = (space.extent(base, sign * axis, _MAX_STROKE) for sign in (1.0, -1.0))
    if up + down < _MIN_STROKE:
        return
    nominal = min(_SHARE * options.duration, _MAX_SECONDS)
    for length in dict.fromkeys((min(up + down, 0.5 * nominal * options.max_speed), up + down)):
        low = float(np.clip(-0.5 * length, -down, up - length))
        bottom, top = base + low * axis, base + (low + length) * axis
        cycle = 2.0 * Line(bottom, top, options).duration
        together = 'together ' * bool(np.count_nonzero(axis) > 1)
        yield (f'{together}back and forth over {length:.2g} rad at {options.max_speed:.2g} rad/s',
               [base, *[top, bottom] * max(1, int(nominal / cycle)), base])


def _bases(space: Workspace, model: GravityModel,
           joint: int) -> list[tuple[str, FloatArray]]:
    """
    Return base poses in reach of a straight line from the start, with a description.

    These are the start and those of largest and smallest load.
    """
    near = [*space.poses[::max(1, len(space.poses) // 60)]]
    for direction in (*np.eye(len(space.low)), *-np.eye(len(space.low))):
        near.append(space.start + direction * space.extent(space.start, direction, 1.0))
    poses = np.array([space.start, *(p for p in near if space.admits_line(space.start, p))])
    load = np.abs(model.predict(poses)[:, joint])
    chosen = {0: '', int(np.argmax(load)): ' at its largest load',
              int(np.argmin(load)): ' at its smallest load'} | {0: ''}
    return [(word, poses[number]) for number, word in chosen.items()]


class Selection:
    """
    Parts of largest utility together with the recordings, in at most `seconds`.

    No part comes twice: repetition averages noise, but not unmodelled torque at its poses.
    """

    def __init__(self, space: Workspace, criterion: Criterion, parts: Sequence[Part],
                 seconds: float) -> None:
        self._criterion, self._seconds = criterion, seconds
        self._candidates = [part for part in parts if _duration([part]) <= seconds]
        self._added = criterion.sums.added([part.lines for part in self._candidates])
        self._is_clear = cache(lambda k: space.is_clear(self._candidates[k].stops))
        chosen: list[int] = []
        while (best := self._best(chosen)) is not None:
            chosen.append(best)
        # Parts from one base follow each other.
        self.parts = [self._candidates[k] for k in chosen]
        self.parts = [part for way in dict.fromkeys(part.way for part in self.parts)
                      for part in self.parts if part.way == way]

    def motion(self) -> tuple[list[Line], list[tuple[float, float]]]:
        """Return the lines from start to start, and start and end time in s of each part."""
        lines: list[Line] = []
        times = []
        for way, parts in groupby(self.parts, lambda part: part.way):
            lines += way
            for part in parts:
                begin = duration(lines)
                lines += part.lines
                times.append((begin, duration(lines)))
            lines += [Line(line.end, line.start, line.limits) for line in way]
        return lines, times

    def _best(self, chosen: list[int]) -> int | None:
        """Return the part of largest gain per time, None if none has a gain."""
        used = self._time(chosen)
        times = {k: self._time([*chosen, k]) - used for k in range(len(self._candidates))
                 if k not in chosen}
        fits = [k for k, time in times.items() if used + time <= self._seconds]
        if not fits:
            return None
        sums = self._criterion.sums.recorded + self._added[chosen].sum(axis=0)
        gains = (self._criterion.utility(sums + self._added[fits])
                 - self._criterion.utility(sums[None]))
        return next((fits[k] for k in np.argsort(-gains / [times[k] for k in fits])
                     if gains[k] > _MIN_GAIN and self._is_clear(fits[k])), None)

    def _time(self, chosen: Sequence[int]) -> float:
        return _duration([self._candidates[k] for k in chosen])


def _duration(parts: Sequence[Part]) -> float:
    """Return the duration of parts with the ways to their bases and back, s."""
    return (sum(part.duration for part in parts)
            + 2.0 * sum(map(duration, {part.way for part in parts})))
