"""Joint velocity from joint position, without delay."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.errors import DataError
import numpy as np
from numpy.typing import ArrayLike

_ORDER = 3
# Multiple of the median interval above which an interval is a gap: several lost messages.
_GAP = 5.0
# Maximum share of the samples for which single windows are faster than sliding ones.
_MAX_SHARE = 0.1
# Number of windows that are fitted at a time.
_MAX_WINDOWS = 512


def differentiate(t: ArrayLike, q: ArrayLike, window: float = 0.2,
                  rows: IntArray | None = None) -> FloatArray:
    """
    Return the velocity (M, N) in rad/s of positions `q` (M, N) in rad at times `t` (M,) in s.

    With `rows` (R,), rising sample numbers, it is that of these samples alone, (R, N).

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
    rows = np.arange(len(times)) if rows is None else rows
    if (steps <= 0).any():
        raise DataError(f'cannot differentiate: time does not increase at sample '
                        f'{int(np.argmax(steps <= 0)) + 1}')
    speed = np.full((len(rows), positions.shape[1]), np.nan)
    if not steps.size:
        return speed
    step = float(np.median(steps))
    ends = np.append(np.flatnonzero(steps > _GAP * step) + 1, len(times))
    begin = 0
    for end in ends:
        here = slice(*np.searchsorted(rows, [begin, end]))
        if end > begin + 1 and here.stop > here.start:
            speed[here] = _stretch(times[begin:end], positions[begin:end], step, window,
                                   times[rows[here]])
        begin = end
    return speed


def _stretch(t: FloatArray, q: FloatArray, step: float, window: float,
             at: FloatArray) -> FloatArray:
    """Return the velocity (R, N) at times (R,) in one stretch without a gap."""
    count = max(int(round((t[-1] - t[0]) / step)) + 1, 2)
    grid = np.linspace(t[0], t[-1], count)
    spacing = grid[1] - grid[0]
    regular = np.stack([np.interp(grid, t, column) for column in q.T], axis=1)
    length = max(2 * int(round(window / (2 * spacing))) + 1, 5)
    if count < 5:
        slope = np.gradient(regular, spacing, axis=0)
    else:
        length = min(length, count if count % 2 else count - 1)
        if len(at) < _MAX_SHARE * count:
            before = np.clip(((at - t[0]) / spacing).astype(int), 0, count - 2)
            needed = np.union1d(before, before + 1)
            slope, grid = _slope_at(regular, length, needed) / spacing, grid[needed]
        else:
            slope = _sliding_slope(regular, length) / spacing
    return np.stack([np.interp(at, grid, column) for column in slope.T], axis=1)


def _slope_at(q: FloatArray, length: int, rows: IntArray) -> FloatArray:
    """Return the slope of `_sliding_slope` at some rows (R,) alone."""
    start = np.clip(rows - length // 2, 0, len(q) - length)
    derivative, cubic = _cubic(length)
    weights = derivative @ cubic[1:]
    slope = np.empty((len(rows), q.shape[1]))
    for k in range(0, len(rows), _MAX_WINDOWS):
        part = slice(k, k + _MAX_WINDOWS)
        windows = q[start[part, None] + np.arange(length)]
        slope[part] = np.einsum('rl,rln->rn', weights[rows[part] - start[part]], windows)
    return slope


def _cubic(length: int) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of the powers 1 to 3 at `length` rows, and the fit of a cubic."""
    half = length // 2
    powers = np.vander(np.arange(-half, half + 1.0), _ORDER + 1, increasing=True)
    return powers[:, :-1] * np.arange(1, _ORDER + 1), np.linalg.pinv(powers)


def _sliding_slope(q: FloatArray, length: int) -> FloatArray:
    """
    Return the slope per row of cubics through `length` rows of q (M, N), an odd number.

    `scipy.signal.savgol_filter` is equivalent, but its import takes as long as a fit.
    """
    from scipy.ndimage import correlate1d  # imported on demand: the import is slow
    half = length // 2
    derivative, cubic = _cubic(length)
    slope = np.asarray(correlate1d(q, cubic[1], axis=0, mode='nearest'))
    # The first and the last cubic are used up to the ends.
    slope[:half] = (derivative @ (cubic[1:] @ q[:length]))[:half]
    slope[-half:] = (derivative @ (cubic[1:] @ q[-length:]))[-half:]
    return slope
