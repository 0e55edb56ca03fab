"""Hold-out of samples from a fit, for errors on unseen data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import IntArray, JointSamples
from gravity_comp_ros.errors import DataError, OptionError
import numpy as np
from numpy.typing import NDArray

# Number of blocks of a single run: the end of a motion alone is often not representative.
_BLOCKS = 2


# Excluded time before and after a held-out block, s: samples are autocorrelated.
GUARD = 1.0


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
           ) -> NDArray[np.bool_]:
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


def _ends(t: NDArray[np.float64]) -> tuple[float, float]:
    return float(t[0]), float(t[-1])
