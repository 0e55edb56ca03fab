"""Time and place of samples within their runs."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
import numpy as np


def run_time(samples: JointSamples) -> FloatArray:
    """Return the time since the start of its run of each sample, (M,) in s."""
    starts = np.zeros(samples.n_runs)
    first = np.flatnonzero(np.diff(samples.runs, prepend=-1))
    starts[samples.runs[first]] = samples.t[first]
    return samples.t - starts[samples.runs]


def longest_run(samples: JointSamples) -> float:
    """Return the duration of the longest run, s."""
    return float(run_time(samples).max(initial=0.0))


def recorded_time(samples: JointSamples) -> float:
    """Return how long all runs take together, s."""
    return float(sum(samples.t[run][-1] - samples.t[run][0] for run in run_slices(samples)))


def run_slices(samples: JointSamples) -> list[slice]:
    """Return where each run that has samples lies."""
    edges = np.flatnonzero(np.diff(samples.runs)) + 1
    bounds = [0, *edges.tolist(), samples.n_samples]
    return [slice(a, b) for a, b in zip(bounds, bounds[1:]) if b > a]
