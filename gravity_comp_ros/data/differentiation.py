"""
Slopes of recorded signals, without delay: velocity, acceleration, and a check of velocity.

A recorded velocity is checked against the position, for drivers that publish counts per second or
degrees: the integral of the measured qd over half a second is compared with the change of q. The
ratio b of integral = b change is fitted through the origin; it should be 1, and their correlation
too. An acceleration is the slope of the speed over a short window, symmetric about each sample and
within one run, so that it is not shifted in time.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.runs import median_interval, numbers_in, run_slices
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import DataError
import numpy as np
from numpy.typing import ArrayLike

_ORDER = 3
# Multiple of the median interval above which an interval is a gap: several lost messages.
_GAP = 5.0


def differentiate(t: ArrayLike, q: ArrayLike, window: float = 0.2) -> FloatArray:
    """
    Return the velocity (M, N) in rad/s of positions `q` (M, N) in rad at times `t` (M,) in s.

    Each stretch without a gap is interpolated on a regular grid and fitted by a sliding cubic
    (Savitzky and Golay) over `window` s, which causes no delay. At low rates the window grows to
    five samples. The row of a single sample between two gaps is NaN.

    :raises DataError: if shapes disagree or time does not increase.
    """
    times, positions = np.asarray(t, dtype=np.float64), np.asarray(q, dtype=np.float64)
    if times.ndim != 1 or positions.ndim != 2 or len(times) != len(positions):
        raise DataError(f'cannot differentiate q of shape {positions.shape} over t of shape '
                        f'{times.shape}')
    steps = np.diff(times)
    if (steps <= 0).any():
        raise DataError(f'cannot differentiate: time does not increase at sample '
                        f'{int(np.argmax(steps <= 0)) + 1}')
    speed = np.full(positions.shape, np.nan)
    if not steps.size:
        return speed
    step = float(np.median(steps))
    edges = np.flatnonzero(np.diff(times, prepend=-np.inf, append=np.inf) > _GAP * step)
    for begin, end in zip(edges, edges[1:]):
        if end > begin + 1:
            _set_slopes(speed[begin:end], times[begin:end], positions[begin:end], step, window)
    return speed


def _set_slopes(out: FloatArray, t: FloatArray, q: FloatArray, step: float,
                window: float) -> None:
    """
    Set the slopes (M, N) of one stretch without a gap, joint by joint to limit memory.

    `scipy.signal.savgol_filter` is equivalent on a regular grid, but its import is slow.
    """
    count = max(int(round((t[-1] - t[0]) / step)) + 1, 2)
    grid, spacing = np.linspace(t[0], t[-1], count, retstep=True)
    length = min(max(2 * int(round(window / (2 * spacing))) + 1, 5), count - 1 + count % 2)
    half = length // 2
    powers = np.vander(np.arange(-half, half + 1.0), _ORDER + 1, increasing=True)
    derivative, cubic = powers[:, :-1] * np.arange(1, _ORDER + 1), np.linalg.pinv(powers)[1:]
    for n, column in enumerate(q.T):
        regular = np.interp(grid, t, column)
        if count < 5:
            slope = np.gradient(regular)
        else:
            # The first and the last cubic are used up to the ends.
            slope = np.concatenate([(derivative @ (cubic @ regular[:length]))[:half],
                                    np.correlate(regular, cubic[0]),
                                    (derivative @ (cubic @ regular[-length:]))[-half:]])
        out[:, n] = np.interp(t, grid, slope / spacing)


# s. Long enough for a motion above the noise of encoders, shorter than a reversal.
SPAN = 0.5
# rad. Minimum change over a span; a smaller one may be encoder noise.
_MIN_CHANGE = 5e-4
_MIN_SPANS = 20
# Bounds of qd / (dq/dt) for consistent velocities, and minimum correlation.
_MIN_RATIO, _MAX_RATIO, _MIN_LIKENESS = 0.5, 2.0, 0.6


def slope_ratios(t: FloatArray, q: FloatArray, qd: FloatArray, rows: IntArray | None = None
                 ) -> tuple[FloatArray, FloatArray]:
    """
    Return the ratio of qd to dq/dt of each joint (N,), and their correlation (N,).

    NaN if a joint moves too little, or if all velocities are 0.

    :param t: times (M,) in s of one run; q, qd (M, N).
    :param rows: numbers (M,) of the samples in the recording. Where several were left out, as
        after a clock was set back, the time does not tell the slope.
    """
    ratio = np.full(q.shape[1], np.nan)
    likeness = ratio.copy()
    steps = np.diff(t)
    rising = steps > 0
    if not rising.any() or not np.nan_to_num(qd).any():
        return ratio, likeness
    median_step = float(np.median(steps[rising]))
    length = max(1, int(round(SPAN / median_step)))
    # The mean slope over a gap is not the velocity.
    is_gap = ~rising | (steps > 3.0 * median_step)
    if rows is not None:
        is_gap |= np.diff(rows) > 3
    gaps = np.append(0, np.cumsum(is_gap))
    whole = gaps[length:] == gaps[:-length]
    for n in range(q.shape[1] if len(t) > length else 0):
        integral = np.append(0.0, np.cumsum(0.5 * (qd[1:, n] + qd[:-1, n]) * steps))
        change = (q[length:, n] - q[:-length, n])[whole]
        area = (integral[length:] - integral[:-length])[whole]
        use = np.abs(change) > _MIN_CHANGE
        if np.count_nonzero(use) >= _MIN_SPANS:
            change, area = change[use], area[use]
            ratio[n] = area @ change / (change @ change)
            size = np.sqrt((area @ area) * (change @ change))
            likeness[n] = area @ change / size if size else np.nan
    return ratio, likeness


def is_inconsistent(ratio: FloatArray, likeness: FloatArray) -> BoolArray:
    """Return the mask (N,) of joints whose velocity contradicts the position."""
    return np.asarray((ratio < _MIN_RATIO) | (ratio > _MAX_RATIO) | (likeness < _MIN_LIKENESS))


# Maximum sample interval, in s, of a recording that resolves starts and stops; static poses are
# recorded less often.
MAX_INTERVAL = 0.06


# Window of the cubics, s: it passes slow arm motion (up to about 2 Hz) and reduces a speed noise
# of 1 mrad/s at 50 Hz to an acceleration noise of about 0.006 rad/s^2.
WINDOW = 0.3


def accelerations(samples: JointSamples) -> FloatArray:
    """
    Return qdd (M, N) in rad/s^2: `samples.qdd` if known, else the slope of qd within each run.

    The slope is 0 at isolated samples.
    """
    if samples.qdd is not None:
        return samples.qdd
    qdd = np.zeros(samples.qd.shape)
    for run in run_slices(samples) if samples.qd.any() else ():
        qdd[run] = differentiate(samples.t[run], samples.qd[run], WINDOW)
    return np.nan_to_num(qdd, copy=False)


def with_accelerations(part: JointSamples, samples: JointSamples) -> JointSamples:
    """
    Return `part`, a selection of `samples`, with accelerations computed from all of these.

    The gate reduces the sample rate, which smooths quick starts and stops. If `samples` do not
    resolve these either, accelerations stay unknown.
    """
    if part.qdd is not None or not median_interval(samples.t, samples.runs) <= MAX_INTERVAL:
        return part
    qdd = accelerations(samples)
    return replace(part, qdd=qdd if part is samples else qdd[numbers_in(samples, part)])


def acceleration_at(t: float, times: FloatArray, qd: FloatArray) -> FloatArray | None:
    """
    Return the acceleration (N,) in rad/s^2 at the time t in s, from the speeds of messages.

    The cubic is that of `with_accelerations`, without interpolation on a regular grid. None if
    the messages on either side do not resolve quick starts and stops.

    :param times: rising times (M,) of the messages in s, and their speeds qd (M, N) in rad/s.
    """
    half = 0.5 * WINDOW
    near = np.abs(times - t) <= half + 1e-9
    x = (times[near] - t) / half
    has_both_sides = len(x) >= 4 and x[0] < -0.5 and x[-1] > 0.5
    if not has_both_sides or np.median(np.diff(x)) * half > MAX_INTERVAL:
        return None
    powers = np.vander(x, 4, increasing=True)
    cubic = np.linalg.lstsq(powers, qd[near], rcond=None)[0]
    return np.asarray(cubic[1] / half)
