"""
Significance of a decrease of the held-out error, block by block.

The gain of a block is log(error before / error after). The logarithm limits the weight of a single
block with a wrong fit or a disturbance.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
import numpy as np
from scipy import special


def p_of_decrease(before: FloatArray, after: FloatArray, tests: float) -> float:
    """
    Return the p-value of Student's one-sided test for a mean gain above 0.

    :param before: errors (B,) of the blocks; likewise `after`.
    :param tests: number of tests, by which p is corrected.
    """
    floor = 1e-6 * before.mean()
    gains = np.log((before + floor) / (after + floor))
    error = max(float(gains.std(ddof=1)) / np.sqrt(len(gains)), 1e-300)
    return min(1.0, tests * float(special.stdtr(len(gains) - 1, -gains.mean() / error)))
