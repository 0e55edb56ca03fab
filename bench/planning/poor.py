"""Poor recordings: motions that leave effects of one joint unidentified."""

from __future__ import annotations

from collections.abc import Callable

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import Arm
import numpy as np

RATE, SECONDS = 25.0, 60.0
# Largest frequency of the sines, Hz; half ranges of wide and narrow motion, rad.
_BAND, _WIDE, _NARROW = 0.12, 0.7, 0.15
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
    wander, moving = _wander(arm, middle, _WIDE, seed), np.arange(arm.n_joints) == joint

    def path(t: FloatArray) -> _Path:
        q, qd, qdd = wander(t)
        return np.where(moving, q, middle), moving * qd, moving * qdd
    return path


def _one_way(t: FloatArray) -> _Path:
    """Return 1.2 rad in one direction at varying speed."""
    w, span = 2 * np.pi * 4 / SECONDS, 1.2 / SECONDS
    return (span * (t + 0.7 * np.sin(w * t) / w) - 0.6, span * (1 + 0.7 * np.cos(w * t)),
            -0.7 * span * w * np.sin(w * t))


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
    'one_speed': _with_own(_one_speed), 'one_posture': _one_posture}
