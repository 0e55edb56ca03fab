"""The whole sparse fit: grow, choose how many samples count as one, prune, finish."""

from __future__ import annotations

from gravity_comp_ros.data.samples import IntArray
from gravity_comp_ros.models.sparse.identifiability import AT_REST
from gravity_comp_ros.models.sparse.sparse_problem import (
    finish, grow, prune, SparseFit, SparseOptions, SparseProblem, with_all_samples)
from gravity_comp_ros.models.sparse.variance_inflation import choose_inflation, correlation_time

# More samples than this, evenly spread over a motion, do not change the support.
_ENOUGH = 1500


def fit_sparse(problem: SparseProblem, options: SparseOptions,
               old: IntArray | None = None) -> SparseFit:
    """
    Return the sparse fit of `problem`: the support from part of the samples, the rest from all.

    :param old: features of an old model to start from. They save a search, and bind nothing: the
        L1 problem is solved from scratch at the end, and the better support is taken.
    :raises FitError: if there are no samples.
    """
    problem = problem.merged(AT_REST)
    few = problem.thinned(_ENOUGH)
    if options.inflation is None:
        grown = grow(few, options, old=old)
        inflation = choose_inflation(few, grown, options).inflation
        pruned = prune(few, grown, inflation)
    else:
        inflation = options.inflation
        pruned = grow(few, options, inflation, old)
    if few is problem:
        return finish(problem, pruned, inflation, options)
    settled = with_all_samples(problem, pruned)
    # Samples that lie closer in time are more alike: more of them count as one.
    closer = correlation_time(problem, settled) / correlation_time(few, pruned)
    return finish(problem, settled, inflation * max(closer, 1.0), options)
