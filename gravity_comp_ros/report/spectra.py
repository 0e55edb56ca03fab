"""How a residual repeats: with time, and with the angle of the joint."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

_LONGEST = 4096
_MOST_POINTS = 400
_MOST_ROWS = 12000
_HIGHEST_ORDER = 80.0
_LEAST_TURN = 0.05
# Steps of the order, in cycles over the visited range.
_FINE = 0.5


def over_time(samples: JointSamples, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return frequencies in Hz and the amplitude density of one joint's residual, N·m/sqrt(Hz).

    Runs are averaged by their length (Welch); uneven samples are put on an even grid first.
    Both are empty where no run has 16 samples.

    :param residual: (M,) in N·m.
    """
    runs = [np.flatnonzero(samples.runs == run) for run in np.unique(samples.runs)]
    runs = [rows for rows in runs if len(rows) >= 16]
    if not runs:
        return np.zeros(0), np.zeros(0)
    from scipy import signal  # half a second that only a report needs
    step = float(np.median(np.concatenate([np.diff(samples.t[rows]) for rows in runs])))
    length = min(_LONGEST, max(16, int(min(np.ptp(samples.t[r]) for r in runs) / step)))
    frequency: FloatArray = np.zeros(0)
    total, weight = np.zeros(1), 0.0
    for rows in runs:
        grid = np.arange(samples.t[rows[0]], samples.t[rows[-1]], step)
        if len(grid) < length:
            continue
        even = np.interp(grid, samples.t[rows], residual[rows])
        frequency, power = signal.welch(even, 1.0 / step, nperseg=length)
        total, weight = total + power * len(grid), weight + len(grid)
    if not weight:
        return np.zeros(0), np.zeros(0)
    density: FloatArray = np.sqrt(total[1:] / weight)
    return _thinned(np.asarray(frequency[1:], dtype=np.float64), density)


def over_angle(q: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """
    Return orders (cycles per turn of the joint) and amplitudes in N·m of one joint's residual.

    Each amplitude is of a sine and cosine of the angle fitted by itself, so poses need not be
    even. The lowest order is one cycle over the range that was visited; both are empty where
    the joint hardly moves.

    :param q: the joint's angle (M,) in rad.
    :param residual: (M,) in N·m.
    """
    travel = float(np.ptp(q)) if len(q) else 0.0
    if travel < _LEAST_TURN:
        return np.zeros(0), np.zeros(0)
    rows = np.arange(0, len(q), max(1, len(q) // _MOST_ROWS))
    q, residual = q[rows], residual[rows] - residual[rows].mean()
    lowest = 2.0 * np.pi / travel
    count = int(_HIGHEST_ORDER / (_FINE * lowest)) + 1
    orders = (_FINE * lowest * np.arange(2.0, count))[:_MOST_POINTS]
    amplitudes = np.zeros(len(orders))
    for k, order in enumerate(orders):
        sine, cosine = np.sin(order * q), np.cos(order * q)
        sine, cosine = sine - sine.mean(), cosine - cosine.mean()
        gram = np.array([[sine @ sine, sine @ cosine], [sine @ cosine, cosine @ cosine]])
        found = lstsq(gram, np.array([sine @ residual, cosine @ residual]), rcond=1e-6)
        amplitudes[k] = float(np.hypot(*found))
    return orders, amplitudes


def _thinned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return at most some hundred points, the largest of each stretch of log x."""
    if len(x) <= _MOST_POINTS:
        return x, y
    place = np.floor((_MOST_POINTS - 1e-9) * np.log(x / x[0]) / np.log(x[-1] / x[0]))
    kept = [here[np.argmax(y[here])] for here in
            np.split(np.arange(len(x)), np.flatnonzero(np.diff(place)) + 1)]
    return np.asarray(x[kept]), np.asarray(y[kept])
