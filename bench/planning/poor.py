"""Poor recordings: motions that leave effects of one joint unidentified."""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import Arm
import numpy as np

RATE, SECONDS = 25.0, 60.0
# Largest frequency of the sines, Hz; half ranges of wide and narrow motion, rad.
_BAND, _WIDE, _NARROW = 0.12, 0.7, 0.15
# Time at which the other joints come to rest in a recording of one posture; ramp; both in s.
_ARRIVED, _RAMP = 24.0, 3.0
_Path = tuple[FloatArray, FloatArray, FloatArray]


def poor_motion(kind: str, arm: Arm, joint: int, seed: int) -> motions.Motion:
    """Return 60 s of poor motion of a joint, number `joint` from 0."""
    middle = np.random.default_rng(seed).uniform(-0.5, 0.5, arm.n_joints)
    return motions.sample(kind, KINDS[kind](arm, joint, middle, seed), SECONDS, RATE)


def _wander(arm: Arm, middle: FloatArray, reach: float, seed: int) -> motions.Path:
    return motions.multisine(middle - reach, middle + reach, arm.max_speed, seed,
                             motions.MultisineOptions(_BAND, SECONDS), SECONDS, RATE).path


def _of_all(reach: float) -> Callable[[Arm, int, FloatArray, int], motions.Path]:
    """Return slow sines of all joints."""
    return lambda arm, joint, middle, seed: _wander(arm, middle, reach, seed)


def _with_own(own: Callable[[FloatArray], _Path]
              ) -> Callable[[Arm, int, FloatArray, int], motions.Path]:
    """Return slow sines of all joints except one, which moves by `own` about its middle."""
    def make(arm: Arm, joint: int, middle: FloatArray, seed: int) -> motions.Path:
        others = _wander(arm, middle, _WIDE, seed)

        def path(t: FloatArray) -> _Path:
            q, qd, qdd = (x.copy() for x in others(t))
            for values, column in zip((q, qd, qdd), own(t)):
                values[:, joint] = column
            q[:, joint] += middle[joint]
            return q, qd, qdd
        return path
    return make


def _one_posture(arm: Arm, joint: int, middle: FloatArray, seed: int) -> motions.Path:
    """Return slow sines of one joint, with the others at rest."""
    return _while(_wander(arm, middle, _WIDE, seed), middle, np.arange(arm.n_joints) == joint,
                  None)


def _one_final_posture(reach: float) -> Callable[[Arm, int, FloatArray, int], motions.Path]:
    """Return motion of the other joints first, then of one joint at their final posture."""
    def make(arm: Arm, joint: int, middle: FloatArray, seed: int) -> motions.Path:
        moving = np.arange(arm.n_joints) == joint
        first = _while(_wander(arm, middle, _WIDE, seed), middle, ~moving, (0.0, _ARRIVED))
        then = _while(_wander(arm, middle, reach, seed + 50), middle, moving, (_ARRIVED, SECONDS))

        def path(t: FloatArray) -> _Path:
            (q, qd, qdd), (a, b, c) = first(t), then(t)
            return q + a - middle, qd + b, qdd + c
        return path
    return make


def _while(path: motions.Path, middle: FloatArray, moving: BoolArray,
           interval: tuple[float, float] | None) -> motions.Path:
    """Return the motion of some joints within an interval, at rest in the middle otherwise."""
    def gated(t: FloatArray) -> _Path:
        q, qd, qdd = path(t)
        w, wd, wdd = (x[:, None] for x in _gate(t, interval))
        away = (q - middle) * moving
        return (middle + w * away, (w * qd + wd * (q - middle)) * moving,
                (w * qdd + 2.0 * wd * qd + wdd * (q - middle)) * moving)
    return gated


def _gate(t: FloatArray, interval: tuple[float, float] | None) -> _Path:
    """Return 1 within an interval and 0 outside, by quintic steps, and two derivatives."""
    if interval is None:
        return np.ones_like(t), np.zeros_like(t), np.zeros_like(t)
    rise, fall = (motions.quintic_step(t - start, _RAMP)
                  for start in (interval[0], interval[1] - _RAMP))
    return rise[0] - fall[0], rise[1] - fall[1], rise[2] - fall[2]


def _one_way(t: FloatArray) -> _Path:
    """Return 1.2 rad in one direction at varying speed."""
    w, span = 2 * np.pi * 4 / SECONDS, 1.2 / SECONDS
    return (span * (t + 0.7 * np.sin(w * t) / w) - 0.6, span * (1 + 0.7 * np.cos(w * t)),
            -0.7 * span * w * np.sin(w * t))


def _few_reversals(t: FloatArray) -> _Path:
    """Return two strokes back and forth of 1 rad."""
    w, size = 2 * np.pi / 30.0, 0.5
    return -size * np.cos(w * t), size * w * np.sin(w * t), size * w ** 2 * np.cos(w * t)


def _few_narrow(t: FloatArray) -> _Path:
    """Return a sine of 0.15 rad."""
    w, size = 2 * np.pi / 15.0, _NARROW
    return size * np.sin(w * t), size * w * np.cos(w * t), -size * w ** 2 * np.sin(w * t)


def _one_speed(t: FloatArray) -> _Path:
    """Return strokes back and forth at 0.1 rad/s, with reversals of 0.4 s."""
    period, speed, reversal = 16.0, 0.1, 0.4

    def velocity(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return direction, share of the speed limit in a reversal, and velocity."""
        x = np.mod(t, period)
        edge = np.minimum(np.minimum(x, np.abs(x - period / 2)), period - x)
        sign = np.where(x < period / 2, 1.0, -1.0)
        share = np.clip(edge / reversal, 0.0, 1.0)
        return sign, share, sign * speed * share * share * (3 - 2 * share)

    sign, share, qd = velocity(t)
    quarter = np.where(np.mod(t, period / 2) < period / 4, 1.0, -1.0)
    slope = np.where(share < 1.0, quarter, 0.0)
    qdd = sign * speed * 6 * share * (1 - share) * slope / reversal
    grid = np.linspace(0.0, SECONDS + 1.0, 20001)
    on_grid = velocity(grid)[2]
    q = np.cumsum(0.5 * (on_grid[1:] + on_grid[:-1]) * np.diff(grid))
    return np.interp(t, grid, np.concatenate([[0.0], q]) - 0.4), qd, qdd


KINDS: dict[str, Callable[[Arm, int, FloatArray, int], motions.Path]] = {
    'one_way': _with_own(_one_way), 'narrow': _of_all(_NARROW),
    'one_speed': _with_own(_one_speed), 'one_posture': _one_posture,
    'few_reversals': _with_own(_few_reversals), 'joint_narrow': _with_own(_few_narrow),
    'settled': _one_final_posture(_WIDE), 'settled_narrow': _one_final_posture(_NARROW)}
