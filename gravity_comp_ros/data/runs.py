"""Time and place of samples within their runs."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
import numpy as np

# A longer pause, in s, ends a session: what warms up or drifts has settled again.
LONGEST_PAUSE = 4.0 * 3600.0


def run_time(samples: JointSamples) -> FloatArray:
    """Return the time since the start of its run of each sample, (M,) in s."""
    starts = np.zeros(samples.n_runs)
    first = np.flatnonzero(np.diff(samples.runs, prepend=-1))
    starts[samples.runs[first]] = samples.t[first]
    return samples.t - starts[samples.runs]


def clock_time(samples: JointSamples) -> FloatArray:
    """
    Return the time of each sample since the start of its session, (M,) in s.

    Runs on one clock belong to one session unless they are hours apart. Where no clock is
    known, or runs overlap on it (recordings that all begin at 0), each run is a session.
    """
    own, runs = run_time(samples), run_slices(samples)
    if not samples.starts or len(runs) < 2:
        return own
    bounds = [(samples.starts[samples.runs[run.start]] + samples.t[run][0],
               samples.starts[samples.runs[run.start]] + samples.t[run][-1], run)
              for run in runs]
    bounds.sort(key=lambda entry: entry[:2])
    time, session = np.empty_like(own), bounds[0][0]
    for place, (start, _, run) in enumerate(bounds):
        if place:
            pause = start - bounds[place - 1][1]
            if pause < 0.0:
                return own
            session = start if pause > LONGEST_PAUSE else session
        time[run] = own[run] + start - session
    return time


def recorded_time(samples: JointSamples) -> float:
    """Return how long all runs take together, s."""
    return float(sum(samples.t[run][-1] - samples.t[run][0] for run in run_slices(samples)))


def run_slices(samples: JointSamples) -> list[slice]:
    """Return where each run that has samples lies."""
    edges = np.flatnonzero(np.diff(samples.runs)) + 1
    bounds = [0, *edges.tolist(), samples.n_samples]
    return [slice(a, b) for a, b in zip(bounds, bounds[1:]) if b > a]
