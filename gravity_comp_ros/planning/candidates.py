"""
Candidate parts of a planned motion.

A part is a tour of straight lines through poses. It starts and ends at rest at one pose, its
`base`. Strokes go back and forth along one joint, or along two neighbours at once; tours of all
joints go through random poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.segments import duration, Limits, Line, through
from gravity_comp_ros.planning.workspace import Workspace
import numpy as np

# Speeds of strokes as shares of the speed limit.
_SPEEDS = (1.0, 0.4)
# Duration of strokes as a share of that of the motion, within limits in s: several short ones are
# better than a long one. Strokes through the whole range of a joint may take all of it.
_SHARE, _MIN_SECONDS, _MAX_SECONDS = 0.25, 3.0, 8.0
# Shortest stroke and largest search distance, rad.
_MIN_STROKE, _MAX_STROKE = 0.02, 3.0
# Number of base poses, and smallest distance between them, rad.
_MAX_BASES, _APART = 4, 0.1
# Tours of all joints: largest distance of a pose from the start, rad; shares of the whole
# duration; number of poses drawn for each; number of tours.
_TOUR_WIDTH, _TOUR_SHARES, _POSES, _TOURS = 1.4, (1.0, 1.0, 0.6), 40, 24


@dataclass(frozen=True, eq=False)
class Part:
    """
    A tour from a base, the first of `stops`, back to it; `what` describes it.

    `way` has the lines from the start of the whole motion to the base.
    """

    what: str
    joints: tuple[int, ...]
    stops: Sequence[FloatArray]
    limits: Limits
    way: tuple[Line, ...] = ()

    @cached_property
    def lines(self) -> tuple[Line, ...]:
        return through(self.stops, self.limits)

    @cached_property
    def duration(self) -> float:
        return duration(self.lines)


def strokes(space: Workspace, model: GravityModel, joint: int, limits: Limits,
            seconds: float) -> list[Part]:
    """Return parts of a motion of `seconds` that move a joint, alone or with a neighbour."""
    eye, n = np.eye(len(space.low)), len(space.low)
    nominal = float(np.clip(_SHARE * seconds, _MIN_SECONDS, _MAX_SECONDS))
    directions: list[tuple[tuple[int, ...], FloatArray, str]] = [((joint,), eye[joint], '')]
    for other in {joint - 1, joint + 1} & set(range(n)):
        directions += [((joint, other), eye[joint] + eye[other], 'in the same direction '),
                       ((joint, other), eye[joint] - eye[other], 'in opposite directions ')]
    parts = []
    for posture, base in _bases(space, model, joint):
        way = through([space.start, base], limits)
        for joints, axis, how in directions:
            up, down = (space.extent(base, sign * axis, _MAX_STROKE) for sign in (1.0, -1.0))
            if up + down < _MIN_STROKE:
                continue
            for slower in map(limits.slower, _SPEEDS):
                short = min(up + down, 0.5 * nominal * slower.speed)
                for length in dict.fromkeys((short, up + down)):
                    low = float(np.clip(-0.5 * length, -down, up - length))
                    bottom, top = base + low * axis, base + (low + length) * axis
                    cycle = 2.0 * Line(bottom, top, slower).duration
                    stops = [base, *[top, bottom] * max(1, int(nominal / cycle)), base]
                    what = (f'back and forth {how}over {length:.2g} rad at '
                            f'{slower.speed:.2g} rad/s{posture}')
                    parts.append(Part(what, joints, stops, slower, way))
    return parts


def tours(space: Workspace, limits: Limits, seconds: float) -> list[Part]:
    """
    Return tours through random poses, all joints moving at once, of up to `seconds`.

    They excite gravity at other poses of all joints, for which strokes have no time.
    """
    rng, parts = np.random.default_rng(0), []
    low = np.maximum(space.low, space.start - _TOUR_WIDTH)
    high = np.minimum(space.high, space.start + _TOUR_WIDTH)
    for number in range(_TOURS):
        longest = seconds * _TOUR_SHARES[number % len(_TOUR_SHARES)]
        shares = rng.uniform(0.0, 1.0, (_POSES, len(space.low)))
        if number % 2:
            # Offsets and elastic torques differ from gravity at the ends of the range.
            shares = shares.round()
        stops = [space.start]
        for pose in low + shares * (high - low):
            tour = through([*stops, pose, space.start], limits)
            if (duration(tour) <= longest and space.admits_line(stops[-1], pose)
                    and space.admits_line(pose, space.start)):
                stops.append(pose)
        if len(stops) > 2:
            parts.append(Part(f'together through {len(stops) - 1} postures, tour {number + 1}',
                              tuple(range(len(space.low))), [*stops, space.start], limits))
    return parts


def _bases(space: Workspace, model: GravityModel,
           joint: int) -> list[tuple[str, FloatArray]]:
    """
    Return base poses in reach of a straight line from the start, with a description.

    These are the start, those of largest and smallest load, and others far from them.
    """
    near = [*space.poses[::max(1, len(space.poses) // 60)]]
    for direction in (*np.eye(len(space.low)), *-np.eye(len(space.low))):
        near.append(space.start + direction * space.extent(space.start, direction, 1.0))
    poses = np.array([space.start, *(p for p in near if space.admits_line(space.start, p))])
    load = np.abs(model.predict(poses)[:, joint])
    chosen = {0: '', **{int(number): word for word, number in (
        (' at its largest load', np.argmax(load)), (' at its smallest load', np.argmin(load)))
        if number}}
    while len(chosen) < _MAX_BASES:
        apart = np.abs(poses[:, None] - poses[list(chosen)]).max(axis=2).min(axis=1)
        if apart.max() < _APART:
            break
        chosen[int(np.argmax(apart))] = ' in another posture'
    return [(word, poses[number]) for number, word in chosen.items()]
