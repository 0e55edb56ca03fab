"""
Candidate parts of a planned motion.

A part starts and ends at rest at one pose, its `base`, and moves one joint or two neighbours. With
targets on more joints there are also tours that move all of them. Short strokes at creeping speed
are not candidates: their information is large, but the direction of motion is then the least
certain, and a diagnosis uses little of them. Nor are sines: they resolve no target better than
strokes and steps.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.segments import Hold, Limits, Line, Segment
from gravity_comp_ros.planning.workspace import Workspace
import numpy as np

# Speeds of strokes of one joint and of two joints, as shares of the speed limit.
_SPEEDS, _SPEED_OF_TWO = (1.0, 0.6, 0.3), 0.45
# Shortest time of repeated strokes, s, and their largest number.
_MIN_REPEATED, _MAX_CYCLES = 3.0, 8
# Longest part in nominal durations; twice that for one through a joint's whole range.
_MAX_OVERTIME = 1.5
# Trial shares of that time without acceleration.
_RANGE_SHARES = (1.0, 0.9, 0.8)
# Stops of a staircase, and the time at each, s.
_STOPS, _STOP_TIME = 4, 0.6
# Smallest stroke and largest search distance of one joint and of several joints, rad.
_MIN_STROKE, _MAX_STROKE, _MAX_STROKE_OF_SEVERAL = 0.02, 3.0, 1.0
_MAX_BASES = 5
# Tours of all joints: largest distance of a posture from the start, rad; shares of the whole
# duration; number of postures drawn for each; number of tours.
_TOUR_WIDTH, _TOUR_SHARES, _POSTURES, _TOURS = 1.4, (1.0, 1.0, 0.6), 40, 24


@dataclass(frozen=True, eq=False)
class Part:
    """Segments from `base` back to it; `what` describes the motion of the joints."""

    what: str
    joints: tuple[int, ...]
    base: FloatArray
    segments: tuple[Segment, ...]

    @property
    def duration(self) -> float:
        return sum(segment.duration for segment in self.segments)


def candidates(space: Workspace, model: GravityModel, joint: int, limits: Limits,
               nominal: float, whole: bool) -> list[Part]:
    """
    Return parts that move a joint, alone or with neighbours, at several postures.

    :param nominal: nominal duration of a part, s: several short ones are better than a long one.
    :param whole: include a part through the whole range of the joint.
    """
    parts: list[Part] = []
    for posture, base in _bases(space, model, joint):
        builder = _PartBuilder(space, limits, nominal, base, posture)
        parts += builder.of_one_joint(joint)
        if whole:
            parts += builder.through_whole_range(joint)
        for partner in (joint - 1, joint + 1):
            if 0 <= partner < space.n_joints:
                parts += builder.of_two_joints((joint, partner))
    return parts


def of_all_joints(space: Workspace, limits: Limits, duration: float) -> list[Part]:
    """
    Return tours of random postures, all joints moving at once, of up to `duration` s.

    They excite gravity at other postures of all joints, for which a short motion of one joint at a
    time has no time.
    """
    rng, parts = np.random.default_rng(0), []
    for number in range(_TOURS):
        length = duration * _TOUR_SHARES[number % len(_TOUR_SHARES)]
        legs: list[Segment] = []
        back: list[Segment] = []
        at, time = space.start, 0.0
        low = np.maximum(space.low, space.start - _TOUR_WIDTH)
        high = np.minimum(space.high, space.start + _TOUR_WIDTH)
        shares = rng.uniform(0.0, 1.0, (_POSTURES, space.n_joints))
        if number % 2:
            # Offsets and elastic torques differ from gravity at the ends of the range.
            shares = shares.round()
        for pose in low + shares * (high - low):
            if not (space.admits_line(at, pose) and space.admits_line(pose, space.start)):
                continue
            leg, home = Line(at, pose, limits), Line(pose, space.start, limits)
            if time + leg.duration + home.duration > length:
                continue
            legs, back, at, time = [*legs, leg], [home], pose, time + leg.duration
        if len(legs) > 1:
            parts.append(Part(f'together through {len(legs)} postures, tour {number + 1}',
                              tuple(range(space.n_joints)), space.start, (*legs, *back)))
    return parts


def travel(space: Workspace, a: FloatArray, b: FloatArray, limits: Limits) -> list[Segment] | None:
    """Return the travel between poses, straight or via the start; None if inadmissible."""
    if np.abs(b - a).max() < 1e-12:
        return []
    if space.admits_line(a, b):
        return [Line(a, b, limits)]
    if space.admits_line(a, space.start) and space.admits_line(space.start, b):
        return [Line(a, space.start, limits), Line(space.start, b, limits)]
    return None


def _bases(space: Workspace, model: GravityModel, joint: int) -> list[tuple[str, FloatArray]]:
    """
    Return base poses in reach of a straight line from the start, with a suffix of `what`.

    These are the start, those of largest and smallest load, and others far from them.
    """
    near = list(space.poses[::max(1, len(space.poses) // 60)])
    for m in range(space.n_joints):
        for sign in (1.0, -1.0):
            direction = sign * np.eye(space.n_joints)[m]
            far = space.extent(space.start, direction, min(space.reach, 1.0))
            near.append(space.start + far * direction)
    poses = np.array([pose for pose in near if space.admits_line(space.start, pose)])
    load = np.abs(model.predict(np.vstack([space.start, poses]))[:, joint])
    bases = [('', space.start)]
    for suffix, pick in ((' at its largest load', np.argmax(load)),
                         (' at its smallest load', np.argmin(load))):
        if pick:
            bases.append((suffix, poses[pick - 1]))
    while len(bases) < _MAX_BASES:
        apart = np.min([np.abs(poses - base).max(axis=1) for _, base in bases], axis=0)
        if apart.max() < 0.1:
            break
        bases.append((' in another posture', poses[np.argmax(apart)]))
    return bases


@dataclass(frozen=True, eq=False)
class _PartBuilder:
    """Builder of parts from a base pose, which `posture` describes."""

    space: Workspace
    limits: Limits
    nominal: float
    base: FloatArray
    posture: str

    def of_one_joint(self, joint: int) -> list[Part]:
        """Return strokes at several speeds, a slow one through the range, and steps."""
        axis = self._axis(joint)
        up, down = self._extents(axis, _MAX_STROKE)
        if up + down < _MIN_STROKE:
            return []
        parts = []
        for speed in (share * self.limits.speed for share in _SPEEDS):
            parts.append(self._repetition(f'back and forth at {speed:.2g} rad/s', (joint,), axis,
                                          *self._stroke(down, up, speed), speed))
        slow = 2.0 * (up + down) / self.nominal
        if slow < self.limits.speed:
            parts.append(self._repetition('slowly through its range', (joint,), axis, -down, up,
                                          slow))
        parts.append(self._steps(joint, axis, down, up))
        return self._short(parts)

    def through_whole_range(self, joint: int) -> list[Part]:
        """Return a part to both ends of a joint's travel, or as far as time admits."""
        axis, speed = self._axis(joint), self.limits.speed
        up, down = self._extents(axis, _MAX_STROKE)
        if up + down <= 0.5 * self.nominal * speed:
            return []
        for share in _RANGE_SHARES:
            low, high = self._stroke(down, up, speed, share * 2.0 * _MAX_OVERTIME * self.nominal)
            whole = high - low > up + down - 1e-9
            far = 'its whole range' if whole else f'{high - low:.2g} rad'
            part = self._repetition(f'once through {far}', (joint,), axis, low, high, speed)
            if self._short([part], 2.0):
                return [part]
        return []

    def of_two_joints(self, joints: tuple[int, int]) -> list[Part]:
        """Return strokes of two joints in equal and in opposite directions."""
        parts = []
        speed = _SPEED_OF_TWO * self.limits.speed
        for sign, how in ((1.0, 'the same direction'), (-1.0, 'opposite directions')):
            axis = self._axis(joints[0]) + sign * self._axis(joints[1])
            up, down = self._extents(axis, _MAX_STROKE_OF_SEVERAL)
            if up + down >= _MIN_STROKE:
                parts.append(self._repetition(f'both in {how}', joints, axis,
                                              *self._stroke(down, up, speed), speed))
        return self._short(parts)

    def _axis(self, joint: int) -> FloatArray:
        return np.eye(self.space.n_joints)[joint]

    def _extents(self, axis: FloatArray, limit: float) -> tuple[float, float]:
        """Return the admissible travel along an axis and against it, rad."""
        return (self.space.extent(self.base, axis, limit),
                self.space.extent(self.base, -axis, limit))

    def _stroke(self, down: float, up: float, speed: float,
                duration: float | None = None) -> tuple[float, float]:
        """Return the ends of a stroke of nominal duration about the base, from -down to up."""
        length = min(up + down, 0.5 * (duration or self.nominal) * speed)
        low = float(np.clip(-0.5 * length, -down, up - length))
        return low, low + length

    def _part(self, what: str, joints: tuple[int, ...], *segments: Segment) -> Part:
        return Part(what + self.posture, joints, self.base, segments)

    def _short(self, parts: list[Part], factor: float = 1.0) -> list[Part]:
        """Return the parts that are not too long."""
        longest = factor * _MAX_OVERTIME * self.nominal
        return [part for part in parts if part.duration <= longest]

    def _repetition(self, what: str, joints: tuple[int, ...], axis: FloatArray, low: float,
                    high: float, speed: float) -> Part:
        """Return repeated strokes between two points of an axis."""
        limits = self.limits.slower(speed)
        bottom, top = self.base + low * axis, self.base + high * axis
        cycle = 2.0 * Line(bottom, top, limits).duration
        count = 1
        if cycle < self.nominal:
            count = int(np.clip(_MIN_REPEATED / max(cycle, 1e-3), 1, _MAX_CYCLES))
        # Down and up in each cycle; the first and last legs start and end at the base.
        stops = [self.base, *[top, bottom] * count, self.base]
        return self._part(what, joints, *(Line(a, b, limits) for a, b in zip(stops, stops[1:])
                                          if np.abs(b - a).max() > 1e-12))

    def _steps(self, joint: int, axis: FloatArray, down: float, up: float) -> Part:
        """Return equal steps from -down to up and back, with a stop at each."""
        steps = np.linspace(-down, up, _STOPS)
        width = steps[1] - steps[0]
        reachable = 0.5 * (self.nominal / (2 * _STOPS) - _STOP_TIME) * self.limits.speed
        steps = steps * min(1.0, max(reachable, _MIN_STROKE) / max(width, 1e-9))
        segments: list[Segment] = []
        at = self.base
        for step in [*steps, *steps[-2::-1]]:
            pose = self.base + step * axis
            segments += [Line(at, pose, self.limits), Hold(pose, _STOP_TIME)]
            at = pose
        return self._part('in steps up and down', (joint,), *segments,
                          Line(at, self.base, self.limits))
