"""
Check of velocity against position, for drivers that publish counts per second or degrees.

The integral of the measured qd over half a second is compared with the change of q. The ratio b
of integral = b change is fitted through the origin; it should be 1, and their correlation too.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.runs import run_slices
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
import numpy as np

# s. Long enough for a motion above the noise of encoders, shorter than a reversal.
_SPAN = 0.5
# rad. Minimum change over a span; a smaller one may be encoder noise.
_MIN_CHANGE = 5e-4
_MIN_SPANS = 20
# Bounds of qd / (dq/dt) for consistent velocities, and minimum correlation.
_MIN_RATIO, _MAX_RATIO, _MIN_LIKENESS = 0.5, 2.0, 0.6


def slope_ratios(t: FloatArray, q: FloatArray, qd: FloatArray,
                 runs: IntArray | None = None) -> tuple[FloatArray, FloatArray]:
    """
    Return the ratio of qd to dq/dt of each joint (N,), and their correlation (N,).

    NaN if a joint moves too little, or if all velocities are 0.

    :param t: times (M,) in s, rising within a run; q, qd (M, N).
    :param runs: run number of each sample (M,), None for one run.
    """
    ratio = np.full(q.shape[1], np.nan)
    likeness = ratio.copy()
    steps = np.diff(t)
    rising = steps > 0 if runs is None else np.diff(runs) == 0
    if not rising.any() or not np.nan_to_num(qd).any():
        return ratio, likeness
    median_step = float(np.median(steps[rising]))
    length = max(1, int(round(_SPAN / median_step)))
    # The mean slope over a gap is not the velocity.
    gaps = np.append(0, np.cumsum(~rising | (steps > 3.0 * median_step)))
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


def checked_velocity(samples: JointSamples) -> tuple[JointSamples, str]:
    """
    Return the samples with velocities consistent with positions, and a warning or ''.

    Inconsistent velocities are replaced by the slope of the positions.
    """
    ratio, likeness = slope_ratios(samples.t, samples.q, samples.qd, samples.runs)
    inconsistent = np.flatnonzero(is_inconsistent(ratio, likeness))
    if not inconsistent.size:
        return samples, ''
    qd = samples.qd.copy()
    for run in run_slices(samples):
        slope = np.nan_to_num(differentiate(samples.t[run], samples.q[run]), nan=0.0)
        for n in inconsistent:
            qd[run, n] = slope[:, n]
    names = ', '.join(f'{samples.names[n]} ({ratio[n]:.2g} times)' for n in inconsistent)
    return replace(samples, qd=qd), (
        f'velocity contradicts position on {names}: the slope of the positions is used instead. '
        f'Check the units of velocity in the driver')
