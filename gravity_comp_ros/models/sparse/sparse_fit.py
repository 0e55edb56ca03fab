"""The sparse fit: growing, variance inflation factor, pruning, final selection."""

from __future__ import annotations

from gravity_comp_ros.models.sparse.identifiability import AT_REST
from gravity_comp_ros.models.sparse.sparse_problem import (
    finish, grow, prune, SparseFit, SparseOptions, SparseProblem, with_all_samples)
from gravity_comp_ros.models.sparse.variance_inflation import choose_inflation, correlation_time

# Number of evenly spread samples beyond which the support does not change.
_MAX_SAMPLES = 1500


def fit_sparse(problem: SparseProblem, options: SparseOptions) -> SparseFit:
    """
    Return the sparse fit of `problem`: the support from thinned samples, coefficients from all.

    :raises FitError: if there are no samples.
    """
    problem = problem.merged(AT_REST)
    few = problem.thinned(_MAX_SAMPLES)
    if options.inflation is None:
        grown = grow(few, options)
        inflation = choose_inflation(few, grown, options).inflation
        pruned = prune(few, grown, inflation)
    else:
        inflation = options.inflation
        pruned = grow(few, options, inflation)
    if few is problem:
        return finish(problem, pruned, inflation, options)
    full = with_all_samples(problem, pruned)
    # Samples closer in time are more strongly autocorrelated.
    ratio = correlation_time(problem, full) / correlation_time(few, pruned)
    return finish(problem, full, inflation * max(ratio, 1.0), options)
