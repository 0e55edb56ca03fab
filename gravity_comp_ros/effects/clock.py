"""
Time of a session, counted from an origin that an effect keeps.

Warming and drift go on from one recording of a morning to the next. With stamps on one clock a
later recording is predicted where it lies in time: the origin is a time on that clock. Without a
clock each run begins at 0, and so does the origin.
"""

from __future__ import annotations

from gravity_comp_ros.data.runs import have_common_clock, run_time, session_time
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Setting
from gravity_comp_ros.effects.refining import FACTOR, scaled
import numpy as np

# Minimum stamp of a clock, in s: simulations and tables begin at 0 each time.
MIN_STAMP = 1e8
# Shortest and longest time constant relative to the longest session, and number of them. A law
# that ends much sooner is an offset of later samples, a much longer one is linear.
_SHORTEST, _LONGEST, _TIMES = 0.1, 3.0, 4


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


def time_constants(samples: JointSamples, minimum: float = 0.0) -> list[float]:
    """Return the time constants in s of a process to compare, those above the minimum."""
    longest = longest_session(samples)
    times: list[float] = np.geomspace(max(_SHORTEST * longest, minimum),
                                      max(_LONGEST * longest, minimum), _TIMES).tolist()
    return times


def longest_session(samples: JointSamples) -> float:
    """Return the duration of the longest session in s."""
    return float(session_time(samples).max(initial=0.0))


def refined_time(setting: Setting, step: float, compared: list[float]) -> list[dict[str, float]]:
    """Return a setting with a shorter and a longer `time`, near those that are compared."""
    return scaled(setting, 'time', step, compared[0] / FACTOR, compared[-1] * FACTOR)
