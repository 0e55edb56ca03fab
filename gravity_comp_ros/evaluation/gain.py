"""
What an effect is worth: the gain in held-out error, block by block, and how sure it is.

A gain is the mean over blocks of log(error before / error after), tested by Student's t over
blocks. A ratio keeps one stretch where a fit goes astray, or where the arm was jolted, from
outweighing all others. Two kinds of effect sit in few blocks and are tested otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
import numpy as np
from scipy import special


@dataclass(frozen=True)
class Gain:
    """
    What an effect does for each block: log of error before over after (B,).

    `share` is what it takes off the error, of all or in the typical block, whichever is more.
    """

    blocks: FloatArray
    share: float
    p: float

    @property
    def mean(self) -> float:
        return float(self.blocks.mean())


def gain(before: FloatArray, after: FloatArray, tests: float) -> Gain:
    """Return the gain from errors (B, J) before to after, with p corrected for `tests`."""
    d = log_ratio(before, after)
    return Gain(d, share(before, after), min(1.0, tests * _p(d, float(d.std(ddof=1)))))


def gain_in_places(before: FloatArray, after: FloatArray, tests: float) -> Gain:
    """
    Return the gain where few blocks may have all of it, as `gain` does.

    The spread is that of the blocks below the median: by chance gains lie evenly about it, and
    what a few places gain must not count as doubt.
    """
    d = log_ratio(before, after)
    return Gain(d, share(before, after), min(1.0, tests * _p(d, _spread_below(d))))


def gain_of_motion(before: FloatArray, after: FloatArray, tests: float) -> Gain:
    """
    Return the gain of what only fast motion shows.

    As `gain_in_places`, but the test is of what goes off each block's RMSE: how quiet blocks
    come off, relative to their small errors, is no evidence against a torque of acceleration.
    """
    gained = (np.sqrt(before) - np.sqrt(after)).sum(axis=1)
    d = log_ratio(before, after)
    p = _p(gained, _spread_below(gained)) if d.mean() > 0.0 else 1.0
    return Gain(d, share(before, after), min(1.0, p * tests))


def _spread_below(d: FloatArray) -> float:
    """Return a standard deviation from what lies below the median."""
    below = np.minimum(d - np.median(d), 0.0)
    return float(np.sqrt(2.0 * (below ** 2).mean()))


def _p(d: FloatArray, spread: float) -> float:
    """Return Student's p of a mean that is not above 0."""
    error = max(spread / np.sqrt(len(d)), 1e-300)
    return float(special.stdtr(len(d) - 1, -d.mean() / error))


def share(before: FloatArray, after: FloatArray) -> float:
    """Return what goes off errors (B, J), of all or in the typical block, the larger."""
    of_all = 1.0 - float(after.sum() / max(before.sum(), 1e-300))
    typical = 1.0 - float(np.exp(-log_ratio(before, after).mean() / before.shape[1]))
    return max(of_all, typical)


def not_worse(better: FloatArray, other: FloatArray) -> bool:
    """Return whether errors `other` (B, J) are within one standard error of `better`."""
    extra = log_ratio(other, better)
    return bool(extra.mean() <= extra.std(ddof=1) / np.sqrt(len(extra)))


def log_ratio(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return log(before / after) of errors (B, J), summed over joints: (B,)."""
    floor = 1e-6 * before.mean(axis=0)
    return np.asarray(np.log((before + floor) / (after + floor)).sum(axis=1))
