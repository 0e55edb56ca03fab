"""The posterior without some rows, from the sums of products: for held-out errors."""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.samples import BoolArray
from gravity_comp_ros.regression.posterior import Posterior, solve


def leave_out(posterior: Posterior, rows: BoolArray) -> Posterior:
    """
    Return the posterior of the other rows, linearised at the same point.

    It equals the posterior of a problem without these rows at the same noise.

    :param rows: mask (R,) of the rows to leave out.
    """
    design = posterior.design.without_rows(rows)
    left = solve(design, posterior.terms, posterior.precision)
    return replace(left, design=design)
