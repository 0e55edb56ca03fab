"""
Time of a session, counted from an origin that an effect keeps.

Warming and drift go on from one recording of a morning to the next. With stamps on one clock a
later recording is predicted where it lies in time: the origin is a time on that clock. Without a
clock each run begins at 0, and so does the origin.
"""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.runs import have_common_clock, run_time, session_time
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Setting
import numpy as np

# Minimum stamp of a clock, in s: simulations and tables begin at 0 each time.
MIN_STAMP = 1e8
# Factor of a refined time constant, and by how much it may lie outside of those compared. A law
# that ends much sooner is an offset of later samples, a much longer one is linear.
_REFINED = 1.33


def has_clock(samples: JointSamples) -> bool:
    """Return whether the stamps are of a clock that goes on from recording to recording."""
    return bool(samples.starts and min(samples.starts) > MIN_STAMP and have_common_clock(samples))


def clock_time(samples: JointSamples) -> FloatArray:
    """Return the time of each sample on the clock, (M,) in s."""
    return np.asarray(np.array(samples.starts)[samples.runs] + samples.t)


def origin_of(samples: JointSamples) -> float:
    """Return the start of the first session on the clock in s, 0 without a clock."""
    if not has_clock(samples) or not samples.n_samples:
        return 0.0
    return float((clock_time(samples) - session_time(samples)).min())


def since(samples: JointSamples, origin: float) -> FloatArray:
    """
    Return the time of each sample since an origin, (M,) in s.

    Without an origin it is the time since its session begins. Samples before the origin are at 0.
    """
    if origin == 0.0:
        return session_time(samples)
    if not samples.starts or min(samples.starts) <= MIN_STAMP:
        return run_time(samples)
    return np.maximum(clock_time(samples) - origin, 0.0)


def refined_time(setting: Setting, step: float, compared: Sequence[float]
                 ) -> list[dict[str, float]]:
    """Return a setting with a shorter and a longer `time`, near those that are compared."""
    low, high = min(compared) / _REFINED, max(compared) * _REFINED
    return [{**setting, 'time': time}
            for time in (setting['time'] * _REFINED ** k for k in (-step, step))
            if low <= time <= high]
