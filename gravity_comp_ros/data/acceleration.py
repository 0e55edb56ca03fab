"""
Accelerations of samples, by differentiation of the speed.

Acceleration is the slope of a cubic fitted to the speed over a short window, symmetric about each
sample and within one run, so that it is not shifted in time.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.runs import rows_of, run_slices
from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
from gravity_comp_ros.data.velocity_check import checked_velocity
import numpy as np

# Maximum sample interval, in s, of a recording that resolves starts and stops.
_MAX_INTERVAL = 0.06


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
    return _slopes(samples, np.arange(samples.n_samples))


def with_accelerations(part: JointSamples, samples: JointSamples) -> JointSamples:
    """
    Return `part`, a selection of `samples`, with accelerations computed from all of these.

    The gate reduces the sample rate, which smooths quick starts and stops. If `samples` do not
    resolve these either, accelerations stay unknown.
    """
    if part.qdd is not None or not is_resolved(samples):
        return part
    rows = np.arange(len(samples)) if part is samples else rows_of(samples, part)
    return replace(part, qdd=_slopes(checked_velocity(samples)[0], rows))


def _slopes(samples: JointSamples, rows: IntArray) -> FloatArray:
    """Return the slope (R, N) of qd at samples number `rows`, rising, within each run."""
    qdd = np.zeros((len(rows), samples.n_joints))
    if not samples.qd.any():
        return qdd
    for run in run_slices(samples):
        here = slice(*np.searchsorted(rows, [run.start, run.stop]))
        qdd[here] = differentiate(samples.t[run], samples.qd[run], WINDOW, rows[here] - run.start)
    return np.nan_to_num(qdd, nan=0.0)


def is_resolved(samples: JointSamples) -> bool:
    """Return whether the sample rate resolves quick starts and stops."""
    within = np.diff(samples.runs) == 0
    return bool(within.any() and np.median(np.diff(samples.t)[within]) <= _MAX_INTERVAL)


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
    if not has_both_sides or np.median(np.diff(x)) * half > _MAX_INTERVAL:
        return None
    powers = np.vander(x, 4, increasing=True)
    cubic = np.linalg.lstsq(powers, qd[near], rcond=None)[0]
    return np.asarray(cubic[1] / half)
