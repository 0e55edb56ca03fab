"""
Accelerations of samples, by differentiation of the speed.

Acceleration is the slope of a cubic fitted to the speed over a short window, symmetric about each
sample and within one run, so that it is not shifted in time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.differentiation import differentiate, DifferentiationOptions
from gravity_comp_ros.data.runs import rows_of, run_slices
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.data.velocity_check import checked_velocity
from gravity_comp_ros.errors import OptionError
import numpy as np

# Maximum sample interval, in s, of a recording that resolves starts and stops.
_MAX_INTERVAL = 0.06


@dataclass(frozen=True)
class AccelerationOptions:
    """
    Differentiation of the speed: cubic fits over `window` s.

    0.3 s passes slow arm motion (up to about 2 Hz) and reduces a speed noise of 1 mrad/s at 50 Hz
    to an acceleration noise of about 0.006 rad/s^2.

    :raises OptionError: if the window is not positive.
    """

    window: float = 0.3

    def __post_init__(self) -> None:
        if not np.isfinite(self.window) or self.window <= 0:
            raise OptionError(f'acceleration window is {self.window} s; it must be positive')


def accelerations(samples: JointSamples,
                  options: AccelerationOptions = AccelerationOptions()) -> FloatArray:
    """
    Return qdd (M, N) in rad/s^2: `samples.qdd` if known, else the slope of qd within each run.

    The slope is 0 at isolated samples.
    """
    if samples.qdd is not None:
        return samples.qdd
    qdd = np.zeros_like(samples.qd)
    if not samples.qd.any():
        return qdd
    how = DifferentiationOptions(window=options.window)
    for run in run_slices(samples):
        qdd[run] = differentiate(samples.t[run], samples.qd[run], how)
    return np.nan_to_num(qdd, nan=0.0)


def with_accelerations(part: JointSamples, samples: JointSamples) -> JointSamples:
    """
    Return `part`, a selection of `samples`, with accelerations computed from all of these.

    The gate reduces the sample rate, which smooths quick starts and stops. If `samples` do not
    resolve these either, accelerations stay unknown.
    """
    if part.qdd is not None or not is_resolved(samples):
        return part
    qdd = accelerations(checked_velocity(samples)[0])
    return replace(part, qdd=qdd if part is samples else qdd[rows_of(samples, part)])


def is_resolved(samples: JointSamples) -> bool:
    """Return whether the sample rate resolves quick starts and stops."""
    within = np.diff(samples.runs) == 0
    return bool(within.any() and np.median(np.diff(samples.t)[within]) <= _MAX_INTERVAL)
