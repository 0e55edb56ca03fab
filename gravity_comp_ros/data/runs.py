"""Runs of samples: time within a run or session, duration, slices."""

from __future__ import annotations

from collections.abc import Iterable

from gravity_comp_ros.data.samples import FloatArray, IntArray, JointSamples
import numpy as np

# Begin and end of a run in s on the clock, and its samples.
RunOnClock = tuple[float, float, slice]

# Maximum pause, in s, within a session. After a longer one the arm has cooled down.
MAX_PAUSE = 4.0 * 3600.0


def run_time(samples: JointSamples) -> FloatArray:
    """Return the time of each sample since the start of its run, (M,) in s."""
    starts = np.zeros(samples.n_runs)
    first = np.flatnonzero(np.diff(samples.runs, prepend=-1))
    starts[samples.runs[first]] = samples.t[first]
    return samples.t - starts[samples.runs]


def session_time(samples: JointSamples) -> FloatArray:
    """
    Return the time of each sample since the start of its session, (M,) in s.

    Runs on one clock belong to one session unless they are hours apart. Without a known clock,
    or if runs overlap on it (recordings that all begin at 0), each run is a session.
    """
    own = run_time(samples)
    if not samples.starts or samples.n_runs < 2 or not have_common_clock(samples):
        return own
    time = np.empty_like(own)
    for session in sessions(_on_clock(samples)):
        for start, _, run in session:
            time[run] = own[run] + start - session[0][0]
    return time


def sessions(runs: Iterable[RunOnClock]) -> list[list[RunOnClock]]:
    """Return runs in order of time, those of a session in one list."""
    result: list[list[RunOnClock]] = []
    last = -np.inf
    for run in sorted(runs, key=lambda entry: entry[:2]):
        if run[0] - last > MAX_PAUSE:
            result.append([])
        result[-1].append(run)
        last = max(last, run[1])
    return result


def have_common_clock(samples: JointSamples) -> bool:
    """Return whether no runs overlap on the clock, unlike recordings that all begin at 0."""
    runs = _on_clock(samples)
    return all(end <= start for (_, end, _), (start, _, _) in zip(runs, runs[1:]))


def _on_clock(samples: JointSamples) -> list[RunOnClock]:
    """Return begin and end in s on the clock and slice of each run, in order of time."""
    bounds = [(samples.starts[samples.runs[run.start]] + samples.t[run][0],
               samples.starts[samples.runs[run.start]] + samples.t[run][-1], run)
              for run in run_slices(samples)]
    return sorted(bounds, key=lambda entry: entry[:2])


def median_interval(t: FloatArray, runs: IntArray) -> float:
    """Return the median interval in s of times (M,) within runs (M,); NaN if there is none."""
    within = np.diff(t)[np.diff(runs) == 0]
    return float(np.median(within)) if len(within) else np.nan


def per_error(t: FloatArray, runs: IntArray, correlation: float) -> float:
    """Return the number of samples of one independent error, of a correlation time in s."""
    return float(np.fmax(1.0, correlation / max(median_interval(t, runs), 1e-6)))


def recorded_time(samples: JointSamples) -> float:
    """Return the total duration of all runs, s."""
    return float(sum(samples.t[run][-1] - samples.t[run][0] for run in run_slices(samples)))


def run_slices(samples: JointSamples) -> list[slice]:
    """Return the slice of each run that has samples."""
    edges = np.flatnonzero(np.diff(samples.runs)) + 1
    bounds = [0, *edges.tolist(), samples.n_samples]
    return [slice(a, b) for a, b in zip(bounds, bounds[1:]) if b > a]


def numbers_in(samples: JointSamples, part: JointSamples) -> IntArray:
    """Return the numbers (M,) of the samples of `part`, a selection of `samples`."""
    rows = np.zeros(part.n_samples, dtype=np.int64)
    for run in np.unique(part.runs):
        here, targets = np.flatnonzero(samples.runs == run), part.runs == run
        rows[targets] = here[np.searchsorted(samples.t[here], part.t[targets])]
    return rows


def reversals_of(path: FloatArray, minimum: float) -> list[tuple[int, float]]:
    """
    Return the samples at which a path (M,) reversed by more than `minimum`, with its new sign.

    The first is that at which its first direction is certain.
    """
    steps = np.diff(path)
    moves = np.flatnonzero(steps)
    # The last sample of each stretch in one direction.
    ends = moves[np.flatnonzero(np.diff(np.sign(steps[moves]), append=0.0))] + 1
    reversals: list[tuple[int, float]] = []
    sign, high, low = 0.0, float(path[0]), float(path[0])
    for k, value in zip(ends.tolist(), path[ends].tolist()):
        high, low = max(high, value), min(low, value)
        if sign <= 0.0 and value > low + minimum:
            sign, high = 1.0, value
        elif sign >= 0.0 and value < high - minimum:
            sign, low = -1.0, value
        else:
            continue
        reversals.append((k, sign))
    return reversals
