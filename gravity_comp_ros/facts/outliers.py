"""Single samples and jumps: wraps of the angle, glitches of the position, spikes of the effort."""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.facts.fact import Action, Fact, Kind, rows_left_out
from gravity_comp_ros.facts.options import FACTS
from gravity_comp_ros.facts.signals import Signals
from gravity_comp_ros.printable import counted
import numpy as np

_TURN = 2 * np.pi


def unwrapped(signals: Signals) -> tuple[FloatArray, Fact | None]:
    """
    Return the positions (M, N) without jumps of whole turns, and the fact if there were any.

    Multiples of 2 pi are chosen so that the median position is nearest to 0. Gravity has the
    period 2 pi.
    """
    jumps: dict[str, float] = {}
    q = signals.q
    for n, name in enumerate(signals.names):
        step = np.diff(q[:, n])
        turns = np.rint(step / _TURN)
        is_wrap = (turns != 0) & (np.abs(step - turns * _TURN) < FACTS.near_turn)
        # Most steps of a motion are small against 2 pi, unlike those between random poses.
        rest = np.abs(step - np.where(is_wrap, turns * _TURN, 0.0))
        if not is_wrap.any() or np.quantile(rest, 0.95) >= FACTS.near_turn:
            continue
        jumps[name] = float(is_wrap.sum())
        q = q.copy() if q is signals.q else q
        q[1:, n] -= np.cumsum(np.where(is_wrap, turns * _TURN, 0.0))
        q[:, n] -= _TURN * np.rint(np.median(q[:, n]) / _TURN)
    if not jumps:
        return q, None
    return q, Fact(
        Kind.WRAPS, tuple(jumps), f'position jumps by whole turns on '
        f'{_with_numbers(jumps, "jump")}', Action.CORRECTED, 'unwrapped',
        '--accept wrapped_positions reads it as recorded', jumps)


def glitches(signals: Signals) -> tuple[BoolArray, Fact | None]:
    """Return the mask (M,) of samples with a position far from both neighbours, and the fact."""
    bad = np.zeros_like(signals.q, dtype=bool)
    # Deviation from both neighbours at a reversal, with the largest acceleration of an arm.
    reversal = 0.5 * FACTS.max_acceleration * signals.interval ** 2
    for n, column in enumerate(signals.q.T):
        deviation = _deviation(column)
        limit = max(FACTS.min_travel, reversal, FACTS.spike_spread * _spread(deviation))
        bad[:, n] = deviation > limit
    return _set_aside(signals, bad, Kind.GLITCHES, 'position is far from both neighbours in')


def spikes(signals: Signals) -> tuple[BoolArray, Fact | None]:
    """Return the mask (M,) of samples with an effort far outside its range, and the fact."""
    bad = np.zeros_like(signals.tau, dtype=bool)
    for n, column in enumerate(signals.tau.T):
        deviation = _deviation(column)
        low, high = np.quantile(column, [0.02, 0.98])
        margin = FACTS.spike_margin * (high - low)
        far = (column > high + margin) | (column < low - margin)
        bad[:, n] = far & (deviation > max(FACTS.spike_spread * _spread(deviation), margin,
                                           FACTS.dead_torque))
    return _set_aside(signals, bad, Kind.SPIKES, 'effort has spikes in')


def _deviation(x: FloatArray) -> FloatArray:
    """
    Return deviations (M,) from the median of five neighbours; the edges are repeated.

    Of the first and last sample it is that from a line through the next two as well: the smaller
    one, because a trend has no median, and a signal that alternates is no line.
    """
    neighbours = np.lib.stride_tricks.sliding_window_view(np.pad(x, 2, mode='edge'), 5)
    deviation = np.abs(x - np.median(neighbours, axis=1))
    for edge, near, next_, five in ((0, 1, 2, x[:5]), (-1, -2, -3, x[-5:])):
        deviation[edge] = min(abs(x[edge] - 2.0 * x[near] + x[next_]),
                              abs(x[edge] - np.median(five)))
    return np.asarray(deviation)


def _spread(deviation: FloatArray) -> float:
    """Return the RMS of deviations (M,) that are limited to their 95 % quantile."""
    limited = np.minimum(deviation, np.quantile(deviation, 0.95))
    return float(np.sqrt(np.mean(limited ** 2)))


def _set_aside(signals: Signals, bad: BoolArray, kind: Kind, what: str
               ) -> tuple[BoolArray, Fact | None]:
    bad[:, bad.mean(axis=0) > FACTS.max_outliers] = False
    rows = np.asarray(bad.any(axis=1))
    if not rows.any():
        return rows, None
    counts = {name: float(count) for name, count in zip(signals.names, bad.sum(axis=0)) if count}
    return rows, rows_left_out(kind, tuple(counts), f'{what} {_with_numbers(counts, "sample")}',
                               rows, counts)


def _with_numbers(counts: dict[str, float], what: str) -> str:
    return ', '.join(f'{name} ({counted(int(count), what)})' for name, count in counts.items())
