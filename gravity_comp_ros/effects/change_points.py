"""When something may have changed in the course of a recording, and what comes after it."""

from __future__ import annotations

from gravity_comp_ros.data.runs import run_slices, run_time
from gravity_comp_ros.data.samples import BoolArray
from gravity_comp_ros.effects.effect import Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Into how many parts a run is cut: a single one finely, several only coarsely, many not at all.
_SHARES_OF_ONE_RUN = 10
_SHARES_OF_SEVERAL = 4
_MOST_RUNS_CUT = 8
_FINER = 0.25


def after(motion: Motion, setting: Setting) -> BoolArray:
    """Return which samples (M,) are at or after `time` s into run number `run`, from 1."""
    runs, time = motion.samples.runs + 1, run_time(motion.samples)
    return np.asarray((runs > setting['run'])
                      | ((runs == setting['run']) & (time >= setting['time'])))


def change_points(motion: Motion) -> list[dict[str, float]]:
    """Return the starts of all runs but the first, and points within each run."""
    samples, time = motion.samples, run_time(motion.samples)
    slices = run_slices(samples)
    parts = _parts(len(slices))
    points = [{'run': float(samples.runs[run.start] + 1), 'time': float(k * time[run][-1] / parts)}
              for run in slices for k in range(parts)]
    return points[1:]


def finer_points(motion: Motion, setting: Setting) -> list[dict[str, float]]:
    """Return points between a change point and its neighbours."""
    if (setting['run'], setting['time']) == (1.0, 0.0):
        return []
    here = motion.samples.runs + 1 == int(setting['run'])
    length = float(run_time(motion.samples)[here].max(initial=0.0))
    step = _FINER * length / _parts(len(run_slices(motion.samples)))
    moved = [setting['time'] + k * step for k in (-2, -1, 1, 2)]
    return [{**setting, 'time': time} for time in moved if 0.0 <= time < length]


def _parts(n_runs: int) -> int:
    if n_runs > _MOST_RUNS_CUT:
        return 1
    return _SHARES_OF_ONE_RUN if n_runs == 1 else _SHARES_OF_SEVERAL
