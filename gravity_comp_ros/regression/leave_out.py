"""The posterior without some rows, from the sums of products: for held-out errors."""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.regression.posterior import Posterior, solve


def leave_out(posterior: Posterior, rows: BoolArray, precision: FloatArray | None = None,
              n_angles: int = 0) -> Posterior:
    """
    Return the posterior of the other rows, linearised at the same point.

    It equals the posterior of a problem without these rows at the same noise.

    :param rows: mask (R,) of the rows to leave out.
    :param precision: weights (N,) of the joints, by default those of the posterior.
    :param n_angles: number of first parameters that keep their value.
    """
    design = posterior.design.without_rows(rows)
    fixed = design.with_narrow(n_angles) if n_angles else design
    other = solve(fixed, posterior.terms, posterior.precision if precision is None else precision)
    return replace(other, design=design)
