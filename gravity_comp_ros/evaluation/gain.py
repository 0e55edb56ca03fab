"""
Gain of an effect in held-out error, block by block, and its significance.

A gain is the mean over blocks of log(error before / error after), tested by Student's t over
blocks. The logarithm limits the weight of a single block with a wrong fit or a disturbance.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
import numpy as np
from scipy import special


@dataclass(frozen=True)
class Gain:
    """
    The gain of an effect in each block: log of error before over after (B,).

    `share` is the relative decrease of the error, in total or of the typical block, whichever is
    larger.
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


def _p(d: FloatArray, std: float) -> float:
    """Return the p-value of Student's one-sided test for a mean above 0."""
    error = max(std / np.sqrt(len(d)), 1e-300)
    return float(special.stdtr(len(d) - 1, -d.mean() / error))


def share(before: FloatArray, after: FloatArray) -> float:
    """Return the relative decrease of errors (B, J), in total or of the typical block."""
    of_all = 1.0 - float(after.sum() / max(before.sum(), 1e-300))
    typical = 1.0 - float(np.exp(-log_ratio(before, after).mean() / before.shape[1]))
    return max(of_all, typical)


def log_ratio(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return log(before / after) of errors (B, J), summed over joints: (B,)."""
    floor = 1e-6 * before.mean(axis=0)
    return np.asarray(np.log((before + floor) / (after + floor)).sum(axis=1))
