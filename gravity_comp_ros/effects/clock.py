"""
Time of a session, counted from an origin that an effect keeps.

Warming and drift go on from one recording of a morning to the next. With stamps on one clock a
later recording is predicted where it lies in time: an effect keeps origin and end of the last
session that it was fitted to. A recording that begins hours after that end is another session.
Without a clock each run begins at 0, and so does the origin.

The samples of a node have no beginning on the clock. They go on from the origin: the arm may have
worked all the time.
"""

from __future__ import annotations

from gravity_comp_ros.data.runs import have_common_clock, run_slices, session_time, sessions
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Setting
from gravity_comp_ros.effects.refining import FACTOR, scaled
import numpy as np

# Minimum stamp of a clock, in s: simulations and tables begin at 0 each time.
MIN_STAMP = 1e8
# Shortest and longest time constant relative to the longest session, and number of them. A law
# that ends much sooner is an offset of later samples, a much longer one is linear.
_SHORTEST, _LONGEST, _TIMES = 0.1, 3.0, 4
# Shortest time constant in s: a gear and the mount of a sensor warm up in minutes. A shorter law
# explains the start of a motion, together with an offset of the opposite sign.
_MIN_TIME = 120.0


def has_clock(samples: JointSamples) -> bool:
    """Return whether the stamps are of a clock that goes on from recording to recording."""
    return is_stamped(samples) and have_common_clock(samples)


def is_stamped(samples: JointSamples) -> bool:
    """Return whether the times of the samples are of a clock."""
    return bool(samples.starts) and float(clock_time(samples).min(initial=np.inf)) > MIN_STAMP


def clock_time(samples: JointSamples) -> FloatArray:
    """Return the time of each sample on the clock, (M,) in s."""
    return np.asarray(np.array(samples.starts)[samples.runs] + samples.t)


def session_of(samples: JointSamples) -> dict[str, float]:
    """Return `origin` and `end` of the last session on the clock in s, 0 without a clock."""
    if not has_clock(samples) or not samples.n_samples:
        return {'origin': 0.0, 'end': 0.0}
    clock = clock_time(samples)
    return {'origin': float((clock - session_time(samples)).max()), 'end': float(clock.max())}


def since(samples: JointSamples, setting: Setting) -> FloatArray:
    """
    Return the time of each sample since its session begins, (M,) in s.

    The session from `origin` to `end` of the setting goes on in later recordings; samples of it
    before the origin are at 0.
    """
    origin = setting['origin']
    if origin == 0.0 or not is_stamped(samples):
        return session_time(samples)
    clock, time, known = clock_time(samples), np.empty(samples.n_samples), slice(0)
    runs = [(samples.starts[samples.runs[run.start]], float(clock[run][-1]), run)
            for run in run_slices(samples)]
    for session in sessions([*runs, (origin, setting['end'], known)]):
        begin = origin if any(run is known for _, _, run in session) else session[0][0]
        for _, _, run in session:
            time[run] = np.maximum(clock[run] - begin, 0.0)
    return time


def time_constants(samples: JointSamples) -> list[float]:
    """Return the time constants in s of a thermal process to compare."""
    longest = max(longest_session(samples), _MIN_TIME)
    times: list[float] = np.geomspace(max(_SHORTEST * longest, _MIN_TIME), _LONGEST * longest,
                                      _TIMES).tolist()
    return times


def longest_session(samples: JointSamples) -> float:
    """Return the duration of the longest session in s."""
    return float(session_time(samples).max(initial=0.0))


def refined_time(setting: Setting, step: float, compared: list[float]) -> list[dict[str, float]]:
    """Return a setting with a shorter and a longer `time`, near those that are compared."""
    return scaled(setting, 'time', step, compared[0] / FACTOR, compared[-1] * FACTOR)
