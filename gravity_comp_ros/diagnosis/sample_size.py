"""
Effective sample size of residuals and of coefficients.

Residuals are autocorrelated: the effective size of M samples is M divided by the correlation time
in samples. A coefficient is a mean of the residual times its column, orthogonal to the other
columns, so that its effective sample size is that of these products (W. Newey, K. West,
Econometrica 55, 1987). A column with frequent sign changes, such as that of Coulomb friction,
has a larger effective sample size than the residual if the residual drifts slowly.
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

# Maximum number of samples for the estimate of a correlation time.
_MAX_SAMPLES = 4000


def effective_sample_size(fits: Fits, motion: Motion, joint: int,
                          chosen: Sequence[Candidate]) -> float:
    """Return the effective sample size of a joint's held-out residual."""
    return _effective(fits.residual(joint, chosen), motion)


def effective_sample_size_of(fits: Fits, motion: Motion, joint: int,
                             chosen: Sequence[Candidate], candidate: Candidate) -> float:
    """
    Return the effective sample size of a chosen effect's coefficient on a joint.

    For an effect with several free coefficients it is that of the residual: the total torque of
    the effect does not represent its least certain coefficient.
    """
    if candidate.n_free(motion) > 1:
        return effective_sample_size(fits, motion, joint, chosen)
    rows, fit = fits.rows[joint], fits.fit(joint, chosen)
    here = np.isin(fit.columns, candidate.columns)
    mine, others = fit.columns[here], fit.columns[~here]
    w = regularised_solve(rows.gram(others)[-1], rows.products(others, mine)[-1])
    every = slice(0, len(rows.y))
    torque = (rows.combined(every, mine, fit.all_data[here])
              - rows.combined(every, others, w @ fit.all_data[here]))
    column = np.empty(len(torque))
    column[rows.row_of] = torque
    return _effective(column * fits.residual(joint, chosen), motion)


def _effective(series: FloatArray, motion: Motion) -> float:
    step = max(1, len(series) // _MAX_SAMPLES)
    runs = motion.samples.runs
    return len(series) / (correlation_time(series[::step], runs[::step]) * step)
