"""
Parts that a planned motion may be made of, each as a person would move to test something.

Every part begins and ends at rest at one pose, its `base`, and moves one to three joints. Where
more joints than that are asked about, there are parts that move all of them.
Short strokes at creeping speed are none of them: by the criterion they tell much, but the
direction of the joint is then the least certain, and a diagnosis sees little in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning.segments import Hold, Line, Pace, Segment, Wave, wave_within
from gravity_comp_ros.planning.workspace import Workspace
import numpy as np

# Shares of the largest speed.
_SPEEDS, _TOGETHER = (1.0, 0.6, 0.3), 0.45
# No part takes longer, s: several short ones are better than one long one.
_LONGEST = 8.0
_SHORTEST = 3.0
# One may take longer by this factor, and one that goes through a joint's whole range by twice it.
_OVER = 1.5
_STOPS, _STOP = 4, 0.6
_LEAST_STROKE = 0.02
# Sizes of waves that are tried, and time between the points at which they are checked, s.
_SHARES, _CHECK = (1.0, 0.7, 0.5, 0.3, 0.15), 0.02
_MOST_BASES = 5
# Tours of all joints: how far their postures are from the start, rad; the share of the whole
# duration that one takes; how many postures are drawn for one, and how many tours.
_WIDEST, _WHOLE, _POSTURES, _TOURS = 1.2, (1.0, 0.6), 40, 16


@dataclass(frozen=True, eq=False)
class Part:
    """Segments from `base` back to it; `what` says in words how which joints move."""

    what: str
    joints: tuple[int, ...]
    base: FloatArray
    segments: tuple[Segment, ...]

    @property
    def duration(self) -> float:
        return sum(segment.duration for segment in self.segments)


def candidates(space: Workspace, model: GravityModel, joint: int, pace: Pace,
               longest: float = _LONGEST, whole: bool = False) -> list[Part]:
    """
    Return parts that move a joint, alone or with a neighbour, at several postures.

    :param whole: whether the joint has to go once through its whole range as well.
    """
    found: list[Part] = []
    for words, base in _bases(space, model, joint):
        found += _of_one_joint(space, joint, words, base, pace, longest)
        if whole:
            found += _whole_range(space, joint, words, base, pace, longest)
        for partner in (joint - 1, joint + 1):
            if 0 <= partner < space.n_joints:
                found += _of_two_joints(space, (joint, partner), words, base, pace, longest)
        found += _of_three_joints(space, joint, words, base, pace, longest)
    return found


def of_all_joints(space: Workspace, pace: Pace, duration: float) -> list[Part]:
    """
    Return tours of drawn postures, all joints moving at once, of up to `duration` s.

    Gravity is then seen at other postures for all joints at once: one joint at a time takes longer
    than a short motion has.
    """
    rng, found = np.random.default_rng(0), []
    for number in range(_TOURS):
        length = duration * _WHOLE[number % len(_WHOLE)]
        legs: list[Segment] = []
        back: list[Segment] = []
        at, time = space.start, 0.0
        for pose in rng.uniform(np.maximum(space.low, space.start - _WIDEST),
                                np.minimum(space.high, space.start + _WIDEST),
                                (_POSTURES, space.n_joints)):
            if not (space.admits_line(at, pose) and space.admits_line(pose, space.start)):
                continue
            leg, home = Line(at, pose, pace), Line(pose, space.start, pace)
            if time + leg.duration + home.duration > length:
                continue
            legs, back, at, time = [*legs, leg], [home], pose, time + leg.duration
        if len(legs) > 1:
            found.append(Part(f'together through {len(legs)} postures, tour {number + 1}',
                              tuple(range(space.n_joints)), space.start, (*legs, *back)))
    return found


def travel(space: Workspace, a: FloatArray, b: FloatArray, pace: Pace) -> list[Segment] | None:
    """Return the way from pose to pose: straight, else by the start; None if there is none."""
    if np.abs(b - a).max() < 1e-12:
        return []
    if space.admits_line(a, b):
        return [Line(a, b, pace)]
    if space.admits_line(a, space.start) and space.admits_line(space.start, b):
        return [Line(a, space.start, pace), Line(space.start, b, pace)]
    return None


def _bases(space: Workspace, model: GravityModel, joint: int) -> list[tuple[str, FloatArray]]:
    """Return postures that a straight way leads to: of little, middle and much load."""
    near = list(space.poses[::max(1, len(space.poses) // 60)])
    for m in range(space.n_joints):
        for sign in (1.0, -1.0):
            direction = sign * np.eye(space.n_joints)[m]
            far = space.extent(space.start, direction, min(space.reach, 1.0))
            near.append(space.start + far * direction)
    poses = np.array([pose for pose in near if space.admits_line(space.start, pose)])
    load = np.abs(model.predict(np.vstack([space.start, poses]))[:, joint])
    found = [('', space.start)]
    for words, pick in (('where it carries most', np.argmax(load)),
                        ('where it carries least', np.argmin(load))):
        if pick:
            found.append((words, poses[pick - 1]))
    # Then the poses farthest from those that are there already.
    while len(found) < _MOST_BASES:
        apart = np.min([np.abs(poses - base).max(axis=1) for _, base in found], axis=0)
        if apart.max() < 0.1:
            break
        found.append(('in another posture', poses[np.argmax(apart)]))
    return found


def _of_one_joint(space: Workspace, joint: int, words: str, base: FloatArray, pace: Pace,
                  longest: float) -> list[Part]:
    axis = np.eye(space.n_joints)[joint]
    up, down = (space.extent(base, sign * axis, 3.0) for sign in (1.0, -1.0))
    if up + down < _LEAST_STROKE:
        return []
    where = f' {words}' if words else ''
    found = []
    for share in _SPEEDS:
        speed = share * pace.speed
        stroke = min(up + down, 0.5 * longest * speed)
        low, high = _centred(down, up, stroke)
        found.append(_to_and_fro(f'to and fro at {speed:.2g} rad/s{where}', (joint,), base, axis,
                                 low, high, pace.slower(speed), longest))
    slow = 2.0 * (up + down) / longest
    if slow < pace.speed:
        found.append(_to_and_fro(f'slowly through its range{where}', (joint,), base, axis, -down,
                                 up, pace.slower(slow), longest))
    found.append(_stairs(f'in steps up and down{where}', joint, base, axis, down, up, pace,
                         longest))
    amplitude = min(up, down) * axis
    if min(up, down) > _LEAST_STROKE:
        wave = wave_within(base, amplitude, np.full(len(base), 0.25), min(longest, 8.0), pace)
        found.append(Part(f'in a sine{where}', (joint,), base, (wave,)))
    return [part for part in found if part.duration <= _OVER * longest]


def _whole_range(space: Workspace, joint: int, words: str, base: FloatArray, pace: Pace,
                 longest: float) -> list[Part]:
    """Return a part that goes once to both ends of a joint's travel, if shorter ones do not."""
    axis = np.eye(space.n_joints)[joint]
    up, down = (space.extent(base, sign * axis, 3.0) for sign in (1.0, -1.0))
    if up + down <= 0.5 * longest * pace.speed:
        return []
    where = f' {words}' if words else ''
    part = _to_and_fro(f'once through its whole range{where}', (joint,), base, axis, -down, up,
                       pace, longest)
    return [part] if part.duration <= 2.0 * _OVER * longest else []


def _of_two_joints(space: Workspace, joints: tuple[int, int], words: str, base: FloatArray,
                   pace: Pace, longest: float) -> list[Part]:
    found = []
    where = f' {words}' if words else ''
    for sign, how in ((1.0, 'the same way'), (-1.0, 'against each other')):
        axis = np.zeros(space.n_joints)
        axis[list(joints)] = 1.0, sign
        up, down = (space.extent(base, s * axis, 1.0) for s in (1.0, -1.0))
        if up + down < _LEAST_STROKE:
            continue
        speed = _TOGETHER * pace.speed
        low, high = _centred(down, up, min(up + down, 0.5 * longest * speed))
        found.append(_to_and_fro(f'both {how}{where}', joints, base, axis, low, high,
                                 pace.slower(speed), longest))
    return [part for part in found if part.duration <= _OVER * longest]


def _of_three_joints(space: Workspace, joint: int, words: str, base: FloatArray, pace: Pace,
                     longest: float) -> list[Part]:
    """Return sines of a joint and its neighbours, each with a frequency of its own."""
    joints = [n for n in (joint - 1, joint, joint + 1) if 0 <= n < space.n_joints]
    frequency, amplitude = np.ones(space.n_joints), np.zeros(space.n_joints)
    duration = min(longest, 8.0)
    for order, n in enumerate(joints):
        frequency[n] = (order % 3 + 1) / duration
        axis = np.eye(space.n_joints)[n]
        amplitude[n] = min(space.extent(base, sign * axis, 1.0) for sign in (1.0, -1.0))
    found = []
    for how, turn in (('slowly', 0), ('in another order', 1)):
        frequency[joints] = np.roll(frequency[joints], turn)
        wave = _admissible(space, base, amplitude, frequency, duration, pace)
        if wave is not None:
            where = f' {words}' if words else ''
            found.append(Part(f'in sines of their own, {how}{where}', tuple(joints), base,
                              (wave,)))
    return found


def _admissible(space: Workspace, base: FloatArray, amplitude: FloatArray, frequency: FloatArray,
                duration: float, pace: Pace) -> Wave | None:
    """Return the widest of some waves that stays within the workspace."""
    for share in _SHARES:
        wave = wave_within(base, share * amplitude, frequency, duration, pace)
        if np.abs(wave.amplitude).max() < _LEAST_STROKE:
            return None
        if space.admits_path(wave.at(np.arange(0.0, duration, _CHECK))[0]):
            return wave
    return None


def _centred(down: float, up: float, stroke: float) -> tuple[float, float]:
    """Return the ends of a stroke about the base, moved to lie between -down and up."""
    low = float(np.clip(-0.5 * stroke, -down, up - stroke))
    return low, low + stroke


def _to_and_fro(what: str, joints: tuple[int, ...], base: FloatArray, axis: FloatArray,
                low: float, high: float, pace: Pace, longest: float) -> Part:
    bottom, top = base + low * axis, base + high * axis
    cycle = 2.0 * Line(bottom, top, pace).duration
    count = int(np.clip(_SHORTEST / max(cycle, 1e-3), 1, 8)) if cycle < longest else 1
    stops = [base, top]
    for _ in range(count):
        stops += [bottom, top]
    # One way down and up for each cycle; the first and last legs lead from and to the base.
    stops = [*stops[:-1], base]
    return Part(what, joints, base, _legs(stops, pace))


def _stairs(what: str, joint: int, base: FloatArray, axis: FloatArray, down: float, up: float,
            pace: Pace, longest: float) -> Part:
    steps = np.linspace(-down, up, _STOPS)
    width = steps[1] - steps[0]
    reachable = 0.5 * (longest / (2 * _STOPS) - _STOP) * pace.speed
    steps = steps * min(1.0, max(reachable, _LEAST_STROKE) / max(width, 1e-9))
    segments: list[Segment] = []
    at = base
    for step in [*steps, *steps[-2::-1]]:
        pose = base + step * axis
        segments += [Line(at, pose, pace), Hold(pose, _STOP)]
        at = pose
    segments.append(Line(at, base, pace))
    return Part(what, (joint,), base, tuple(segments))


def _legs(stops: Sequence[FloatArray], pace: Pace) -> tuple[Segment, ...]:
    return tuple(Line(a, b, pace) for a, b in zip(stops, stops[1:])
                 if np.abs(b - a).max() > 1e-12)
