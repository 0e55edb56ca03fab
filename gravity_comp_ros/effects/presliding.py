"""Dahl's element: friction that builds up over some way after a joint has turned."""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
import numpy as np

# An encoder that flutters by this many times its noise has not moved.
_FLUTTER = 3.0
# Steps of time that differ by less are even; where fewer windows are, all must serve.
_EVEN = 1.2
_ENOUGH_EVEN = 0.05


def presliding_state(path: FloatArray, distance: float) -> FloatArray:
    """
    Return how far friction has built up along a path (M,) in rad of one run: z from -1 to 1.

    Dahl's element, dz/dq = (1 - z sign(dq)) / distance, solved exactly between turns (Dahl
    1968): z = s + (z_turn - s) exp(-way since the turn / distance), s the direction. It starts
    at 0, of which nothing is left after a few distances.

    :param distance: rad.
    """
    steps = np.diff(path, prepend=path[:1])
    way, towards = np.cumsum(np.abs(steps)), np.sign(steps)
    # A pause goes on in the direction before it, so that it is no turn.
    last_move = np.maximum.accumulate(np.where(towards != 0.0, np.arange(len(path)), 0))
    towards = towards[last_move]
    begin = np.append(0, np.flatnonzero(np.diff(towards, prepend=towards[:1])))
    end = np.append(begin[1:], len(path))
    begun = np.where(begin > 0, way[begin - 1], 0.0)
    kept = np.exp((begun - way[end - 1]) / distance)
    states, state = [], 0.0
    for sign, part in zip(towards[begin].tolist(), kept.tolist()):
        states.append(state)
        state = sign + (state - sign) * part
    started, since = np.repeat(np.array([states, begun]), end - begin, axis=1)
    return np.asarray(towards + (started - towards) * np.exp((since - way) / distance))


def steady_path(q: FloatArray, t: FloatArray | None = None) -> FloatArray:
    """
    Return q (M,) of one run without the flutter of its encoder, rad.

    :param t: times (M,) in s; even ones if not given.

    A joint has turned where q has gone back by nine times the noise, and its turn is where q went
    furthest. From turn to turn the path only goes on, so that an encoder's noise at rest does not
    wear down what friction has built up.
    """
    leash = _FLUTTER * position_noise(q, t)
    if leash <= 0.0:
        return q
    turned = _turned(_pulled(q, leash), leash)
    path, at, sign = np.empty_like(q), 0, turned[0][1] if turned else 0.0
    for seen, _ in turned[1:]:
        turn = at + int(np.argmax(sign * q[at:seen + 1]))
        path[at:turn + 1] = sign * np.maximum.accumulate(sign * q[at:turn + 1])
        at, sign = turn, -sign
    path[at:] = sign * np.maximum.accumulate(sign * q[at:]) if sign else q[0]
    return path


def _turned(path: FloatArray, least: float) -> list[tuple[int, float]]:
    """Return where it shows that a path (M,) goes another way by more than `least`, and which."""
    steps = np.diff(path)
    moves = np.flatnonzero(steps)
    # The last sample of each stretch in one direction.
    ends = moves[np.flatnonzero(np.diff(np.sign(steps[moves]), append=0.0))] + 1
    found: list[tuple[int, float]] = []
    sign, high, low = 0.0, float(path[0]), float(path[0])
    for k, value in zip(ends.tolist(), path[ends].tolist()):
        high, low = max(high, value), min(low, value)
        if sign <= 0.0 and value > low + least:
            sign, high = 1.0, value
            found.append((k, sign))
        elif sign >= 0.0 and value < high - least:
            sign, low = -1.0, value
            found.append((k, sign))
    return found


def _pulled(q: FloatArray, leash: float) -> FloatArray:
    """Return q (M,) as it pulls something along on a leash: what is shorter does not move it."""
    # Each sample clips the path to a range, and clips one after another are one clip again: so
    # those of 2, 4, 8 ... samples follow from each other. The first one leaves no choice.
    low, high = q - leash, q + leash
    low[0] = high[0] = q[0]
    step = 1
    while step < len(q):
        low[step:], high[step:] = (np.clip(before[:-step], low[step:], high[step:])
                                   for before in (low, high))
        step *= 2
    return low


def position_noise(q: FloatArray, t: FloatArray | None = None) -> float:
    """
    Return the standard deviation of what in q (M,) of one run is noise, rad.

    :param t: times (M,) in s; where a message is lost, a difference is of motion, not of noise.
    """
    jumps = np.diff(q, n=4)
    if t is not None:
        jumps = jumps[evenly_spaced(t)]
    # Fourth differences of white noise have 70 times its variance.
    return float(1.4826 * np.median(np.abs(jumps)) / np.sqrt(70.0)) if len(jumps) else 0.0


def evenly_spaced(t: FloatArray) -> BoolArray:
    """Return which of the M - 4 windows of five samples are evenly spaced in time t (M,)."""
    steps = np.diff(t)
    if len(steps) < 4:
        return np.zeros(0, dtype=bool)
    windows = np.lib.stride_tricks.sliding_window_view(steps, 4)
    even = windows.max(axis=1) <= _EVEN * windows.min(axis=1)
    return np.asarray(even if even.mean() >= _ENOUGH_EVEN else np.ones(len(even), dtype=bool))
