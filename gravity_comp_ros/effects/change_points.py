"""
When something may have changed in the course of a recording, and what that does to a torque.

The gravity of a model is that of the end of a recording. The effect describes what was different
before the change. The change is one moment of the clock, so recordings made later are predicted
without it. Where no clock is known, it is a run and a time within that run.
"""

from __future__ import annotations

from gravity_comp_ros.data.runs import have_common_clock, run_slices, run_time
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Into how many parts a run is cut: a single one finely, several only coarsely, many not at all.
_SHARES_OF_ONE_RUN = 10
_SHARES_OF_SEVERAL = 4
_MOST_RUNS_CUT = 8
_FINER = 0.25
# Stamps below this, in s, are no clock: simulations and tables begin at 0 each time.
_LEAST_STAMP = 1e8
UNITS = {'run': 'run number', 'time': 's', 'clock': 's'}


def change(motion: Motion, setting: Setting) -> FloatArray:
    """
    Return the factor of a change at each sample, (M,): -1 before it, 0 from it on.

    Without `clock`, the setting is one of older models, whose gravity is that of the beginning: 0
    before, 1 from it on.
    """
    if 'clock' not in setting:
        return 1.0 + _lacks(_before(motion.samples, setting))
    samples, clock = motion.samples, setting['clock']
    if clock == 0.0:
        return _lacks(_before(samples, setting))
    if not samples.starts:
        return np.zeros(samples.n_samples)
    return _lacks(np.array(samples.starts)[samples.runs] + samples.t < clock)


def _lacks(before: BoolArray) -> FloatArray:
    return np.where(before, -1.0, 0.0)


def _before(samples: JointSamples, setting: Setting) -> BoolArray:
    """Return which samples (M,) are before `time` s into run number `run`, from 1."""
    runs = samples.runs + 1
    return np.asarray((runs < setting['run'])
                      | ((runs == setting['run']) & (run_time(samples) < setting['time'])))


def change_points(motion: Motion) -> list[dict[str, float]]:
    """Return the starts of all runs but the first, and points within each run."""
    samples, time = motion.samples, run_time(motion.samples)
    slices = run_slices(samples)
    parts = _parts(len(slices))
    points = [_point(samples, int(samples.runs[run.start]), float(k * time[run][-1] / parts))
              for run in slices for k in range(parts)]
    return [point for point in points if change(motion, point).any()]


def finer_points(motion: Motion, setting: Setting) -> list[dict[str, float]]:
    """Return points between a change point and its neighbours."""
    if 'clock' not in setting:
        return []
    run = int(setting['run']) - 1
    here = motion.samples.runs == run
    length = float(run_time(motion.samples)[here].max(initial=0.0))
    step = _FINER * length / _parts(len(run_slices(motion.samples)))
    moved = [setting['time'] + k * step for k in (-2, -1, 1, 2)]
    return [_point(motion.samples, run, time) for time in moved if 0.0 <= time < length]


def _point(samples: JointSamples, run: int, time: float) -> dict[str, float]:
    """Return the setting of a change `time` s into a run; its `clock` is 0 where none is known."""
    stamp = 0.0
    if samples.starts and have_common_clock(samples) and min(samples.starts) > _LEAST_STAMP:
        first = samples.t[np.searchsorted(samples.runs, run)]
        stamp = float(samples.starts[run] + first + time)
    return {'run': run + 1.0, 'time': time, 'clock': stamp}


def _parts(n_runs: int) -> int:
    if n_runs > _MOST_RUNS_CUT:
        return 1
    return _SHARES_OF_ONE_RUN if n_runs == 1 else _SHARES_OF_SEVERAL
