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
    own = run_time(samples)
    if not samples.starts or samples.n_runs < 2 or not one_clock(samples):
        return own
    time, session, last = np.empty_like(own), -np.inf, -np.inf
    for start, end, run in _on_clock(samples):
        session = start if start - last > LONGEST_PAUSE else session
        time[run], last = own[run] + start - session, end
    return time


def one_clock(samples: JointSamples) -> bool:
    """Return whether no two runs overlap on the clock, as recordings that all begin at 0 do."""
    runs = _on_clock(samples)
    return all(end <= start for (_, end, _), (start, _, _) in zip(runs, runs[1:]))


def _on_clock(samples: JointSamples) -> list[tuple[float, float, slice]]:
    """Return when each run begins and ends on the clock in s, and its samples, in that order."""
    bounds = [(samples.starts[samples.runs[run.start]] + samples.t[run][0],
               samples.starts[samples.runs[run.start]] + samples.t[run][-1], run)
              for run in run_slices(samples)]
    return sorted(bounds, key=lambda entry: entry[:2])


def recorded_time(samples: JointSamples) -> float:
    """Return how long all runs take together, s."""
    return float(sum(samples.t[run][-1] - samples.t[run][0] for run in run_slices(samples)))


def run_slices(samples: JointSamples) -> list[slice]:
    """Return where each run that has samples lies."""
    edges = np.flatnonzero(np.diff(samples.runs)) + 1
    bounds = [0, *edges.tolist(), samples.n_samples]
    return [slice(a, b) for a, b in zip(bounds, bounds[1:]) if b > a]
