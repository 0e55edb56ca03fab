"""
How many samples count as independent.

Neighbouring residuals are alike. The variance of a mean of M of them is that of M over the
correlation time, counted in samples. A coefficient is a mean of residuals times its column,
the other columns taken off it, so that its correlation time is that of these products (W. Newey,
K. West, Econometrica 55, 1987): a column that changes its sign often, as that of Coulomb friction
does at each reversal, makes many independent samples of a residual that drifts.
"""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.candidates import Candidate
from gravity_comp_ros.diagnosis.evidence import regularised_solve
from gravity_comp_ros.diagnosis.fits import Fits
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.noise import correlation_time
import numpy as np

# Samples that a correlation time is found from.
_MOST = 4000


def effective(fits: Fits, motion: Motion, joint: int, chosen: Sequence[Candidate]) -> float:
    """Return how many samples of a joint's held-out residual count as independent."""
    return _counted(fits.residual(joint, chosen), motion)


def effective_of(fits: Fits, motion: Motion, joint: int, chosen: Sequence[Candidate],
                 candidate: Candidate) -> float:
    """
    Return how many independent samples of a joint the size of a chosen effect comes from.

    Of an effect with several free coefficients the samples of the residual count: a product of
    their sum with it says nothing of the one that is known worst.
    """
    if candidate.n_free(motion) > 1:
        return effective(fits, motion, joint, chosen)
    rows, fit = fits.rows[joint], fits.fit(joint, chosen)
    here = np.isin(fit.columns, candidate.columns)
    mine, others = fit.columns[here], fit.columns[~here]
    w = regularised_solve(rows.gram(others)[-1], rows.products(others, mine)[-1])
    every = slice(0, len(rows.y))
    torque = (rows.combined(every, mine, fit.all_data[here])
              - rows.combined(every, others, w @ fit.all_data[here]))
    column = np.empty(len(torque))
    column[rows.row_of] = torque
    return _counted(column * fits.residual(joint, chosen), motion)


def _counted(series: FloatArray, motion: Motion) -> float:
    step = max(1, len(series) // _MOST)
    runs = motion.samples.runs
    return len(series) / (correlation_time(series[::step], runs[::step]) * step)
