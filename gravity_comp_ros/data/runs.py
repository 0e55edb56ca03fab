"""Runs of samples: time within a run or session, duration, slices, parts that are held out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
import numpy as np

# Begin and end of a run in s on the clock, and its samples.
RunOnClock = tuple[float, float, slice]

# Maximum pause, in s, within a session. After a longer one the arm has cooled down.
MAX_PAUSE = 4.0 * 3600.0
# Number of blocks of a single run: the end of a motion alone is often not representative.
_BLOCKS = 2
# Excluded time before and after a held-out block, s: samples are autocorrelated.
GUARD = 1.0


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


@dataclass(frozen=True)
class Block:
    """A stretch of time of one run, ends included: `start`, `end` in s."""

    run: int
    start: float
    end: float


def blocks_to_hold_out(samples: JointSamples, fraction: float = 0.2,
                       guard: float = GUARD) -> tuple[Block, ...]:
    """
    Return the blocks of time that are held out.

    With several runs, the last `fraction` of the runs is held out, at least one. With a single
    run, two blocks of consecutive time are held out, `fraction` of its duration together; samples
    are autocorrelated, so the error on scattered ones would be too small. Samples within `guard`
    seconds of a block are not fitted.

    :raises OptionError: if the fraction is not between 0 and 1, or the guard is negative.
    :raises DataError: if one of the two would be empty.
    """
    if not 0.0 < fraction < 1.0:
        raise OptionError(f'holdout: the fraction is {fraction}; it must be between 0 and 1')
    if not 0.0 <= guard < np.inf:
        raise OptionError(f'holdout: the guard is {guard} s; it must not be negative')
    if samples.n_samples == 0:
        raise DataError('there are no samples to hold out')
    filled = np.unique(samples.runs)
    count = min(max(1, round(fraction * filled.size)), filled.size - 1)
    blocks = _whole_runs(samples, filled[-count:]) if count else _parts(samples, fraction)
    if not within(samples, blocks).any() or within(samples, blocks, guard).all():
        raise DataError(f'{samples.n_samples} samples are too few to hold {fraction:.0%} '
                        'out and fit the rest')
    return blocks


def within(samples: JointSamples, blocks: Sequence[Block], guard: float = 0.0
           ) -> BoolArray:
    """Return the mask (M,) of samples in a block, or within `guard` seconds of it."""
    inside = np.zeros(samples.n_samples, dtype=bool)
    for block in blocks:
        inside |= ((samples.runs == block.run) & (samples.t >= block.start - guard)
                   & (samples.t <= block.end + guard))
    return inside


def _whole_runs(samples: JointSamples, runs: IntArray) -> tuple[Block, ...]:
    return tuple(Block(run, *_ends(samples.t[samples.runs == run])) for run in runs.tolist())


def _parts(samples: JointSamples, fraction: float) -> tuple[Block, ...]:
    """Return the last part of each half of the only run that has samples."""
    run = int(samples.runs[0])
    first, last = _ends(samples.t)
    half = (last - first) / _BLOCKS
    return tuple(Block(run, first + half * (k + 1 - fraction), first + half * (k + 1))
                 for k in range(_BLOCKS))


def _ends(t: FloatArray) -> tuple[float, float]:
    return float(t[0]), float(t[-1])
