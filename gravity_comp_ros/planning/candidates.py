"""
Candidate parts of a planned motion.

A part is a tour of straight lines through poses. It starts and ends at rest at one pose, its base.
Strokes go back and forth along one joint, or along several in drawn directions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.segments import duration, Limits, Line, through
from gravity_comp_ros.planning.workspace import Workspace
import numpy as np

# Duration of strokes as a share of that of the motion, and at most in s: several short ones are
# better than a long one. Strokes through the whole range of a joint may take all of it.
_SHARE, _MAX_SECONDS = 0.25, 8.0
# Shortest stroke and largest search distance, rad.
_MIN_STROKE, _MAX_STROKE = 0.02, 3.0
# Number of drawn directions of several joints from each base.
_TOGETHER = 2


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


def strokes(space: Workspace, model: GravityModel, joints: Sequence[int], limits: Limits,
            seconds: float) -> list[Part]:
    """Return parts of a motion of `seconds` that move one of some joints, or all at once."""
    rng, parts = np.random.default_rng(0), []
    for joint in joints:
        for posture, base in _bases(space, model, joint):
            way = through([space.start, base], limits)
            axes = [np.eye(len(base))[joint]]
            for _ in range(_TOGETHER * (len(joints) > 1)):
                axes.append(np.zeros(len(base)))
                axes[-1][list(joints)] = rng.choice([-1.0, 1.0], len(joints))
            parts += [Part(what + posture, tuple(np.flatnonzero(axis).tolist()), stops,
                           through(stops, limits), way) for axis in axes
                      for what, stops in _along(space, base, axis, limits, seconds)]
    return parts


def _along(space: Workspace, base: FloatArray, axis: FloatArray, limits: Limits,
           seconds: float) -> Iterator[tuple[str, list[FloatArray]]]:
    """Yield strokes along an axis about a base, and over all of the axis that is admitted."""
    up, down = (space.extent(base, sign * axis, _MAX_STROKE) for sign in (1.0, -1.0))
    if up + down < _MIN_STROKE:
        return
    nominal = min(_SHARE * seconds, _MAX_SECONDS)
    for length in dict.fromkeys((min(up + down, 0.5 * nominal * limits.speed), up + down)):
        low = float(np.clip(-0.5 * length, -down, up - length))
        bottom, top = base + low * axis, base + (low + length) * axis
        cycle = 2.0 * Line(bottom, top, limits).duration
        together = 'together ' * bool(np.count_nonzero(axis) > 1)
        yield (f'{together}back and forth over {length:.2g} rad at {limits.speed:.2g} rad/s',
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
