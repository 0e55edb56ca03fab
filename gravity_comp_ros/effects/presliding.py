"""Dahl's element: friction that builds up over a distance after a reversal."""

from __future__ import annotations

import math
from typing import Any

from gravity_comp_ros.data.runs import reversals_of
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.white_noise import white_noise
import numpy as np

# Half-width of the play operator that removes encoder noise, in standard deviations.
_NOISE_WIDTHS = 3.0
# Minimum motion, as a share of the distance, that counts as a reversal of a live element. Encoder
# noise at rest is smaller; it would otherwise erase the state.
_MIN_REVERSAL = 0.1


class LiveElement:
    """
    Dahl's element angle by angle, as a control loop reads them.

    :param distance: rad. :param skew: as in `presliding_state`.
    """

    def __init__(self, distance: float, skew: float = 0.0) -> None:
        self._distance, self._skew = distance, skew
        # The last angle in the present direction, and the state there.
        self._angle: float | None = None
        self._direction = self._state = 0.0

    def state(self, angle: float) -> float:
        """Return the state, from -1 to 1, at an angle in rad; angles are in order of time."""
        if self._angle is None:
            self._angle = angle
        moved = angle - self._angle
        direction = math.copysign(1.0, moved)
        over = self._distance * (1.0 + self._skew * direction)
        state: float = _built_up(self._state, direction + self._skew,
                                 math.exp(-abs(moved) / over))
        if direction == self._direction or abs(moved) >= _MIN_REVERSAL * self._distance:
            self._angle, self._direction, self._state = angle, direction, state
        return state


def presliding_state(path: FloatArray, distance: float, skew: float = 0.0) -> FloatArray:
    """
    Return the state z, from -1 to 1, of Dahl's element along a path (M,) in rad of one run.

    dz/dq = (1 - z sign(dq)) / distance is solved exactly between reversals (Dahl 1968):
    z = s + (z_r - s) exp(-d / distance), s the direction, z_r the state at the reversal and d the
    distance since then. The initial state is 0 and decays within a few distances.

    :param distance: rad.
    :param skew: by how much the level is larger in the positive direction, less than 1. The
        stiffness is the same in both, so the levels are skew + s and the distances
        (1 + s skew) distance.
    """
    steps = np.diff(path, prepend=path[:1])
    travelled, direction = np.cumsum(np.abs(steps)), np.sign(steps)
    # The direction persists during a pause, so that a pause is not a reversal.
    last_move = np.maximum.accumulate(np.where(direction != 0.0, np.arange(len(path)), 0))
    direction = direction[last_move]
    begin = np.append(0, np.flatnonzero(np.diff(direction, prepend=direction[:1])))
    end = np.append(begin[1:], len(path))
    at_begin = np.where(begin > 0, travelled[begin - 1], 0.0)
    level, over = direction + skew * np.abs(direction), distance * (1.0 + skew * direction)
    decay = np.exp((at_begin - travelled[end - 1]) / over[begin])
    states, state = [], 0.0
    for final, factor in zip(level[begin].tolist(), decay.tolist()):
        states.append(state)
        state = _built_up(state, final, factor)
    initial, since = np.repeat(np.array([states, at_begin]), end - begin, axis=1)
    return np.asarray(_built_up(initial, level, np.exp((since - travelled) / over)))


def _built_up(state: Any, level: Any, decay: Any) -> Any:
    """Return the state after a motion towards a level; `decay` is exp(-travel / distance)."""
    return level + (state - level) * decay


def denoised_path(q: FloatArray, t: FloatArray | None = None) -> FloatArray:
    """
    Return q (M,) of one run in rad, monotonic between reversals.

    A reversal is detected where q has returned by nine standard deviations of the encoder noise;
    it is located at the extremum of q. Encoder noise at rest then does not change the state of
    presliding friction.

    :param t: times (M,) in s; evenly spaced by default.
    """
    play = _NOISE_WIDTHS * float(white_noise([(q, t)]))
    if play <= 0.0:
        return q
    detected = reversals_of(_play_operator(q, play), play)
    path, at, sign = np.empty_like(q), 0, detected[0][1] if detected else 0.0
    for sample, _ in detected[1:]:
        extremum = at + int(np.argmax(sign * q[at:sample + 1]))
        path[at:extremum + 1] = sign * np.maximum.accumulate(sign * q[at:extremum + 1])
        at, sign = extremum, -sign
    path[at:] = sign * np.maximum.accumulate(sign * q[at:]) if sign else q[0]
    return path


def _play_operator(q: FloatArray, play: float) -> FloatArray:
    """Return the output (M,) of a play operator (backlash) of half-width `play` for input q."""
    # Each sample clips the output to a range, and a sequence of clips is one clip: those of
    # 2, 4, 8 ... samples follow from each other. The first sample fixes the output.
    low, high = q - play, q + play
    low[0] = high[0] = q[0]
    step = 1
    while step < len(q):
        low[step:], high[step:] = (np.clip(before[:-step], low[step:], high[step:])
                                   for before in (low, high))
        step *= 2
    return low
