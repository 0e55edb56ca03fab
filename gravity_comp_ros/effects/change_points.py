"""
Change points within a recording, and the factor of an effect before and after them.

The gravity of a model is that of the end of a recording; an effect describes the difference
before the change. A change point is a clock time, so later recordings are predicted without the
effect. Without a clock it is a run and a time within that run.
"""

from __future__ import annotations

from gravity_comp_ros.data.runs import have_common_clock, run_slices, run_time
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Numbers of parts of a single run and of one of several runs; more runs than this are not divided.
_PARTS_OF_ONE_RUN = 10
_PARTS_OF_SEVERAL = 4
_MAX_RUNS_DIVIDED = 8
# Step of refined change points, relative to a part of a run.
_FINER = 0.25
# Minimum stamp of a clock, in s: simulations and tables begin at 0 each time.
_MIN_STAMP = 1e8
UNITS = {'run': 'run number', 'time': 's', 'clock': 's'}


def change_factor(motion: Motion, setting: Setting) -> FloatArray:
    """
    Return the factor of a change at each sample, (M,): -1 before it, 0 from it on.

    Without `clock`, the setting is one of older models, whose gravity is that of the beginning: 0
    before, 1 from it on.
    """
    samples = motion.samples
    if 'clock' not in setting:
        return np.where(_before(samples, setting), 0.0, 1.0)
    if setting['clock'] == 0.0:
        return np.where(_before(samples, setting), -1.0, 0.0)
    if not samples.starts:
        return np.zeros(samples.n_samples)
    clock = np.array(samples.starts)[samples.runs] + samples.t
    return np.where(clock < setting['clock'], -1.0, 0.0)


def _before(samples: JointSamples, setting: Setting) -> BoolArray:
    """Return a mask (M,) of the samples before `time` s in run number `run`, from 1."""
    runs = samples.runs + 1
    return np.asarray((runs < setting['run'])
                      | ((runs == setting['run']) & (run_time(samples) < setting['time'])))


def change_points(motion: Motion) -> list[dict[str, float]]:
    """Return the starts of all runs except the first, and points within each run."""
    samples, time = motion.samples, run_time(motion.samples)
    slices = run_slices(samples)
    parts = _parts(len(slices))
    points = [_point(samples, int(samples.runs[run.start]), float(k * time[run][-1] / parts))
              for run in slices for k in range(parts)]
    return [point for point in points if change_factor(motion, point).any()]


def finer_points(motion: Motion, setting: Setting) -> list[dict[str, float]]:
    """Return change points between a given one and its neighbours."""
    if 'clock' not in setting:
        return []
    run = int(setting['run']) - 1
    here = motion.samples.runs == run
    length = float(run_time(motion.samples)[here].max(initial=0.0))
    step = _FINER * length / _parts(len(run_slices(motion.samples)))
    moved = [setting['time'] + k * step for k in (-2, -1, 1, 2)]
    return [_point(motion.samples, run, time) for time in moved if 0.0 <= time < length]


def _point(samples: JointSamples, run: int, time: float) -> dict[str, float]:
    """Return the setting of a change at `time` s in a run; `clock` is 0 without a clock."""
    stamp = 0.0
    if samples.starts and have_common_clock(samples) and min(samples.starts) > _MIN_STAMP:
        first = samples.t[np.searchsorted(samples.runs, run)]
        stamp = float(samples.starts[run] + first + time)
    return {'run': run + 1.0, 'time': time, 'clock': stamp}


def _parts(n_runs: int) -> int:
    if n_runs > _MAX_RUNS_DIVIDED:
        return 1
    return _PARTS_OF_ONE_RUN if n_runs == 1 else _PARTS_OF_SEVERAL
