"""The whole sparse fit: grow, choose how many samples count as one, prune, finish."""

from __future__ import annotations

from gravity_comp_ros.gravity.inflation import choose_inflation
from gravity_comp_ros.gravity.sparse import (
    finish, grow, prune, SparseFit, SparseOptions, SparseProblem)


def fit_sparse(problem: SparseProblem, options: SparseOptions) -> SparseFit:
    """
    Return the sparse fit of `problem`.

    :raises FitError: if there are no samples.
    """
    grown = grow(problem, options)
    inflation = options.inflation
    if inflation is None:
        inflation = choose_inflation(problem, grown, options).inflation
    return finish(problem, prune(problem, grown, inflation), inflation, options)
