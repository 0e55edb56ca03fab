"""
Change points within a recording, and the factor of an effect before and after them.

The gravity of a model is that of the end of a recording; an effect describes the difference
before the change. A change point is a clock time, so later recordings are predicted without the
effect. Without a clock it is a run and a time within that run.
"""

from __future__ import annotations

from gravity_comp_ros.data.runs import recorded_time, run_slices, run_time
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.clock import clock_time, has_clock
from gravity_comp_ros.effects.effect import Effect, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Numbers of parts of a single run and of one of several runs; more runs than this are not divided.
_PARTS_OF_ONE_RUN = 10
_PARTS_OF_SEVERAL = 4
_MAX_RUNS_DIVIDED = 8
# Minimum duration of motion before and after a change, in s: with less, the effect is a part of
# gravity. Accuracy in s of a duration computed from a share of the samples.
_MIN_DURATION, _ROUNDING = 10.0, 0.1
# Step of refined change points, relative to a part of a run.
_FINER = 0.5
UNITS = {'run': 'run number', 'time': 's', 'clock': 's'}


def change_factor(motion: Motion, setting: Setting) -> FloatArray:
    """
    Return the factor of a change at each sample, (M,): -1 before it, 0 from it on.

    Without a clock a setting is valid in the recordings that it was found in only.
    """
    samples = motion.samples
    if setting['clock'] == 0.0:
        return np.where(_before(samples, setting), -1.0, 0.0)
    if not samples.starts:
        return np.zeros(samples.n_samples)
    return np.where(clock_time(samples) < setting['clock'], -1.0, 0.0)


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
    return _with_motion(motion, points)


def finer_points(motion: Motion, setting: Setting, step: float) -> list[dict[str, float]]:
    """Return change points between a given one and its neighbours."""
    run = int(setting['run']) - 1
    here = motion.samples.runs == run
    length = float(run_time(motion.samples)[here].max(initial=0.0))
    width = step * _FINER * length / _parts(len(run_slices(motion.samples)))
    moved = [setting['time'] + k * width for k in (-1, 1)]
    return _with_motion(motion, [_point(motion.samples, run, time) for time in moved
                                 if 0.0 <= time < length])


def _with_motion(motion: Motion, points: list[dict[str, float]]) -> list[dict[str, float]]:
    """Return the change points with enough motion before and after them."""
    seconds = recorded_time(motion.samples)
    before = [seconds * float((change_factor(motion, point) < 0.0).mean()) for point in points]
    return [point for point, time in zip(points, before)
            if min(time, seconds - time) >= _MIN_DURATION - _ROUNDING]


def _point(samples: JointSamples, run: int, time: float) -> dict[str, float]:
    """Return the setting of a change at `time` s in a run; `clock` is 0 without a clock."""
    stamp = 0.0
    if has_clock(samples):
        first = samples.t[np.searchsorted(samples.runs, run)]
        stamp = float(samples.starts[run] + first + time)
    return {'run': run + 1.0, 'time': time, 'clock': stamp}


def _parts(n_runs: int) -> int:
    if n_runs > _MAX_RUNS_DIVIDED:
        return 1
    return _PARTS_OF_ONE_RUN if n_runs == 1 else _PARTS_OF_SEVERAL


class ChangeEffect(Effect):
    """An effect that begins at a change point, which is its setting."""

    setting_units = UNITS
    is_static = True
    resembles_gravity = True

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return change_points(motion)

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        return finer_points(motion, setting, step)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if change_points(motion):
            return None
        return (f'the recordings take {recorded_time(motion.samples):.1f} s: a change requires '
                f'{_MIN_DURATION:.0f} s of motion before and after it')
