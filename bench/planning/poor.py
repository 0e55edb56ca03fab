"""Poor recordings: motion of an arm that leaves something open about one joint."""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import Arm
import numpy as np

RATE, SECONDS = 25.0, 60.0
_BAND, _WIDE, _NARROW = 0.12, 0.7, 0.15
# In a recording of one posture the other joints come to rest after this time, s.
_ARRIVED, _RAMP = 24.0, 3.0
_Path = tuple[FloatArray, FloatArray, FloatArray]


def poor_motion(kind: str, arm: Arm, joint: int, seed: int) -> motions.Motion:
    """Return 60 s of motion that lacks something on a joint, number `joint` from 0."""
    middle = np.random.default_rng(seed).uniform(-0.5, 0.5, arm.n_joints)
    return motions.sample(kind, KINDS[kind](arm, joint, middle, seed), SECONDS, RATE)


def _wander(arm: Arm, middle: FloatArray, reach: float, seed: int) -> motions.Path:
    return motions.multisine(middle - reach, middle + reach, arm.max_speed, seed,
                             motions.MultisineOptions(_BAND, SECONDS), SECONDS, RATE).path


def _of_all(reach: float) -> Callable[[Arm, int, FloatArray, int], motions.Path]:
    """Return every joint's own slow sines."""
    return lambda arm, joint, middle, seed: _wander(arm, middle, reach, seed)


def _with_own(own: Callable[[FloatArray], _Path]
              ) -> Callable[[Arm, int, FloatArray, int], motions.Path]:
    """Return slow sines of all joints but one, which moves about its middle as `own` says."""
    def make(arm: Arm, joint: int, middle: FloatArray, seed: int) -> motions.Path:
        others = _wander(arm, middle, _WIDE, seed)

        def path(t: FloatArray) -> _Path:
            q, qd, qdd = (x.copy() for x in others(t))
            for values, mine in zip((q, qd, qdd), own(t)):
                values[:, joint] = mine
            q[:, joint] += middle[joint]
            return q, qd, qdd
        return path
    return make


def _one_posture(arm: Arm, joint: int, middle: FloatArray, seed: int) -> motions.Path:
    """Return slow sines of one joint, the others at rest all the time."""
    return _while(_wander(arm, middle, _WIDE, seed), middle, np.arange(arm.n_joints) == joint,
                  None)


def _settled(reach: float) -> Callable[[Arm, int, FloatArray, int], motions.Path]:
    """Return motion of the others first, then of one joint at the posture that they come to."""
    def make(arm: Arm, joint: int, middle: FloatArray, seed: int) -> motions.Path:
        mine = np.arange(arm.n_joints) == joint
        first = _while(_wander(arm, middle, _WIDE, seed), middle, ~mine, (0.0, _ARRIVED))
        then = _while(_wander(arm, middle, reach, seed + 50), middle, mine, (_ARRIVED, SECONDS))

        def path(t: FloatArray) -> _Path:
            (q, qd, qdd), (a, b, c) = first(t), then(t)
            return q + a - middle, qd + b, qdd + c
        return path
    return make


def _while(path: motions.Path, middle: FloatArray, moving: BoolArray,
           stretch: tuple[float, float] | None) -> motions.Path:
    """Return the motion of some joints in a stretch of time, at rest in the middle else."""
    def made(t: FloatArray) -> _Path:
        q, qd, qdd = path(t)
        w, wd, wdd = (x[:, None] for x in _gate(t, stretch))
        away = (q - middle) * moving
        return (middle + w * away, (w * qd + wd * (q - middle)) * moving,
                (w * qdd + 2.0 * wd * qd + wdd * (q - middle)) * moving)
    return made


def _gate(t: FloatArray, stretch: tuple[float, float] | None) -> _Path:
    """Return 1 within a stretch and 0 outside, by quintic steps, and two derivatives."""
    if stretch is None:
        return np.ones_like(t), np.zeros_like(t), np.zeros_like(t)
    rise, fall = _step(t - stretch[0]), _step(t - stretch[1] + _RAMP)
    return rise[0] - fall[0], rise[1] - fall[1], rise[2] - fall[2]


def _step(t: FloatArray) -> _Path:
    x = np.clip(t / _RAMP, 0.0, 1.0)
    return (x ** 3 * (10 - 15 * x + 6 * x ** 2), 30 * x ** 2 * (1 - x) ** 2 / _RAMP,
            60 * x * (1 - x) * (1 - 2 * x) / _RAMP ** 2)


def _one_way(t: FloatArray) -> _Path:
    """Return a turn of 1.2 rad, now faster, now slower, never back."""
    w, span = 2 * np.pi * 4 / SECONDS, 1.2 / SECONDS
    return (span * (t + 0.7 * np.sin(w * t) / w) - 0.6, span * (1 + 0.7 * np.cos(w * t)),
            -0.7 * span * w * np.sin(w * t))


def _few_reversals(t: FloatArray) -> _Path:
    """Return two turns to and fro of 1 rad."""
    w, size = 2 * np.pi / 30.0, 0.5
    return -size * np.cos(w * t), size * w * np.sin(w * t), size * w ** 2 * np.cos(w * t)


def _few_narrow(t: FloatArray) -> _Path:
    """Return a sine of 0.15 rad."""
    w, size = 2 * np.pi / 15.0, _NARROW
    return size * np.sin(w * t), size * w * np.cos(w * t), -size * w ** 2 * np.sin(w * t)


def _one_speed(t: FloatArray) -> _Path:
    """Return a turn to and fro at 0.1 rad/s; it turns back within 0.4 s."""
    period, speed, turn = 16.0, 0.1, 0.4
    x = np.mod(t, period)
    edge = np.minimum(np.minimum(x, np.abs(x - period / 2)), period - x)
    sign = np.where(x < period / 2, 1.0, -1.0)
    share = np.clip(edge / turn, 0.0, 1.0)
    qd = sign * speed * share * share * (3 - 2 * share)
    slope = np.where(edge < turn, np.where(np.mod(x, period / 2) < period / 4, 1.0, -1.0), 0.0)
    qdd = sign * speed * 6 * share * (1 - share) * slope / turn
    fine = np.linspace(0.0, SECONDS + 1.0, 20001)
    return np.interp(t, fine, _integral(fine, period, speed, turn)), qd, qdd


def _integral(t: FloatArray, period: float, speed: float, turn: float) -> FloatArray:
    x = np.mod(t, period)
    edge = np.minimum(np.minimum(x, np.abs(x - period / 2)), period - x)
    share = np.clip(edge / turn, 0.0, 1.0)
    qd = np.where(x < period / 2, 1.0, -1.0) * speed * share * share * (3 - 2 * share)
    return np.concatenate([[0.0], np.cumsum(0.5 * (qd[1:] + qd[:-1]) * np.diff(t))]) - 0.4


KINDS: dict[str, Callable[[Arm, int, FloatArray, int], motions.Path]] = {
    'one_way': _with_own(_one_way), 'narrow': _of_all(_NARROW),
    'one_speed': _with_own(_one_speed), 'one_posture': _one_posture,
    'few_reversals': _with_own(_few_reversals), 'joint_narrow': _with_own(_few_narrow),
    'settled': _settled(_WIDE), 'settled_narrow': _settled(_NARROW)}
