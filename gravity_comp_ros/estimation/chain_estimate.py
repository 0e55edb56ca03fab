"""
Robust fit of a chain jointly with effects and nuisance terms.

A first search includes all nuisance columns. Its residual identifies the friction shape of each
joint and the outliers; insignificant coefficients are dropped. The chain is then fitted with the
remaining terms, starting from the axes of the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.nuisance_columns import (
    fitted_shapes, NuisanceColumns, significant)
from gravity_comp_ros.estimation.regression import Regression
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit, fit_chain, rough_fit
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions, STRUCTURE_LIMIT
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.models.nuisance import COULOMB
from gravity_comp_ros.models.sparse.weighted_nuisance import WeightedNuisance
import numpy as np

_ROBUST_ROUNDS = 3
_ROUGH = SearchOptions(starts=24, rivals=0)
_FINAL, _WARM = SearchOptions(), SearchOptions(rivals=0)
# Maximum number of selections of friction shapes and nuisance terms: a local minimum may hide
# significant terms, so they are tested again while the residual is not white.
_MAX_SELECTIONS = 3
# Maximum difference of the log width or distance of similar friction shapes.
_SIMILAR_WIDTH = 0.3
# Minimum decrease of the log residual by a selection for which another one follows.
_MIN_SELECTION_GAIN = 0.02
# Samples of the first search, and of those that follow while the residual is not white, as shares
# of the recording: the wrong minima of other samples are others.
_PARTS = ((0.0, 1.0), (0.0, 0.7), (0.3, 1.0))
# Difference of log residuals below which no further search follows: recordings with unmodelled
# effects have several minima with similar residuals.
_SIMILAR = 0.1
# Maximum number of samples of the search, and of the tests of nuisance terms.
_MAX_SEARCH_SAMPLES, _MAX_TEST_SAMPLES = 250, 600


@dataclass(frozen=True, eq=False)
class ChainEstimate:
    """The fitted chain, and the regression with its final nuisance terms and robust weights."""

    fit: ChainFit
    regression: Regression

    @property
    def chain(self) -> Chain:
        return self.fit.chain

    @property
    def coefficients(self) -> FloatArray:
        """Return the coefficients (K,) of `regression.linear_terms()`."""
        return self.fit.nuisance

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance (K, K) of the coefficients, fitted jointly with gravity."""
        return self.fit.nuisance_covariance

    def residual(self) -> FloatArray:
        """Return the residual (m, N) in N·m of gravity and linear terms."""
        return residual_of(self.fit, self.regression)

    def log_residual(self) -> float:
        """Return the mean logarithm of the joints' median residual."""
        return _log_residual(self.fit, self.regression)


def residual_of(fit: ChainFit, regression: Regression) -> FloatArray:
    """Return the residual (m, N) in N·m of a fit, its linear terms included."""
    return regression.residual(fit.chain.torque(regression.samples.q), fit.nuisance)


def estimate_chain(regression: Regression, known: FloatArray | None = None,
                   start: Chain | None = None, warm: bool = False,
                   max_searches: int = len(_PARTS)) -> ChainEstimate:
    """
    Fit a chain jointly with the linear terms of a regression.

    :param known: axes (N, 3, 3) that need no search.
    :param start: a chain to start from.
    :param warm: whether `start` is the only start, and no alternative chains are searched.
    :param max_searches: maximum number of searches while the residual is not white.
    :raises FitError: if there are no samples.
    """
    estimate = _estimate(regression, known, start, warm)
    if known is not None or start is not None:
        # An earlier search found the start.
        return estimate
    for seed in range(1, max_searches):
        if estimate.fit.structure <= STRUCTURE_LIMIT:
            break
        # A minimum with a residual that is not white may be a wrong one.
        other = _estimate(regression, known, start, warm, seed)
        gain = estimate.log_residual() - other.log_residual()
        starts = estimate.fit.starts + other.fit.starts
        estimate = other if gain > 0.0 else estimate
        estimate = replace(estimate, fit=replace(estimate.fit, starts=starts))
        if abs(gain) < _SIMILAR:
            break
    return estimate


def _estimate(regression: Regression, known: FloatArray | None, start: Chain | None, warm: bool,
              seed: int = 0) -> ChainEstimate:
    """Return the estimate of one search, on a part of the samples and from random axes."""
    chain, starts = start, 1
    if chain is None or known is not None or not warm:
        part = _part(regression, *_PARTS[seed]).thinned(_MAX_SEARCH_SAMPLES)
        first = _search(part, known, start, seed)
        chain, starts = first.chain, first.starts
    last: NuisanceColumns | None = None
    best: tuple[float, Regression, ChainFit] | None = None
    for _ in range(_MAX_SELECTIONS):
        all_terms = _refined(regression, chain)
        rough = _fit(all_terms.thinned(_MAX_TEST_SAMPLES), chain, known)
        regression = _with_significant(all_terms, rough)
        if last is not None and _are_similar(last, regression.nuisance):
            break
        last = regression.nuisance
        fit = _fit(regression, rough.chain, known, _WARM if warm else _FINAL)
        chain, size = fit.chain, _log_residual(fit, regression)
        gain = np.inf if best is None else best[0] - size
        if gain > 0.0:
            best = size, regression, fit
        if (fit.inflation == 1.0).all() or gain < _MIN_SELECTION_GAIN:
            break
    assert best is not None
    regression, fit = _without_insignificant(*best[1:], known)
    return ChainEstimate(replace(fit, starts=starts), regression)


def _are_similar(one: NuisanceColumns, other: NuisanceColumns) -> bool:
    """Return whether two selections have the same terms and nearly the same friction shapes."""
    if one.columns != other.columns:
        return False
    pairs = [(one.shapes[c.joint], other.shapes[c.joint]) for c in one.columns
             if c.kind == COULOMB]
    return all(a.ramp == b.ramp and (a.hold > 0.0) == (b.hold > 0.0) and
               abs(np.log((a.hold or a.width) / (b.hold or b.width))) < _SIMILAR_WIDTH
               for a, b in pairs)


def _without_insignificant(regression: Regression, fit: ChainFit, known: FloatArray | None
                           ) -> tuple[Regression, ChainFit]:
    """
    Return the fit without nuisance terms that are insignificant in it.

    A term may be significant only in a fit with all others. An offset that the samples do not
    determine is an error of gravity.
    """
    fewer = _with_significant(regression, fit)
    if fewer.nuisance.columns == regression.nuisance.columns:
        return regression, fit
    return fewer, _fit(fewer, fit.chain, known, _WARM)


def _with_significant(regression: Regression, fit: ChainFit) -> Regression:
    """Return the regression with the nuisance terms that are significant in a fit of it."""
    k = regression.n_effects
    return regression.with_terms(significant(fit.nuisance[k:], fit.nuisance_covariance[k:, k:]))


def _part(regression: Regression, start: float, end: float) -> Regression:
    """Return the regression of the samples between two shares of the recording."""
    share = np.arange(regression.samples.n_samples) / regression.samples.n_samples
    return regression.select((share >= start) & (share < end))


def _search(regression: Regression, known: FloatArray | None, start: Chain | None,
            seed: int) -> ChainFit:
    """
    Return the chain of a search, or of known axes (N, 3, 3).

    If its residual is not white, a second search without priors of the nuisance terms follows;
    it has different local minima. Both results are compared with priors.
    """
    samples, terms = regression.samples, regression.linear_terms()
    if known is not None:
        return fit_chain(samples, _ROUGH, None, known, terms)
    options = replace(_ROUGH, seed=seed)
    fit = rough_fit(samples, options, start, terms)
    if fit.clean or terms.columns is None:
        return fit
    free = rough_fit(samples, options, start, replace(terms, spread=None))
    other = rough_fit(samples, None, free.chain, terms)
    return min((fit, replace(other, starts=free.starts)),
               key=lambda each: _log_residual(each, regression))


def _log_residual(fit: ChainFit, regression: Regression) -> float:
    """Return the mean logarithm of the joints' median residual, independent of their scale."""
    size = np.median(np.abs(residual_of(fit, regression)), axis=0)
    return float(np.log(np.maximum(size, floor(regression.samples.tau))).mean())


def _fit(regression: Regression, start: Chain, known: FloatArray | None,
         final: SearchOptions | None = None) -> ChainFit:
    """Return the local minimum near `start`; with `final` as `fit_chain` does."""
    samples, terms = regression.samples, regression.linear_terms()
    if known is not None:
        return fit_chain(samples, SearchOptions(), None, known, terms)
    if final is None:
        return rough_fit(samples, None, start, terms)
    return fit_chain(samples, final, start, None, terms, multi_start=False)


def _refined(regression: Regression, chain: Chain) -> Regression:
    """Return the regression with friction shapes and robust weights from a chain's residual."""
    regression = regression.reweighted(_robust_residual(chain, regression))
    recorded = regression.recorded
    if not recorded.qd.any():
        return regression
    # The shapes are fitted to a residual that includes friction.
    residual = recorded.tau - chain.torque(recorded.q)
    return regression.with_shapes(fitted_shapes(recorded, regression.qdd, residual))


def _robust_residual(chain: Chain, regression: Regression) -> FloatArray:
    """Return the residual (m, N) in N·m of a chain and robustly fitted linear terms."""
    without_gravity = regression.samples.tau - chain.torque(regression.samples.q)
    terms = regression.linear_terms()
    if terms.columns is None:
        return without_gravity
    min_sigma, residual = floor(regression.samples.tau), without_gravity
    robust_weights = np.ones(residual.shape)
    for _ in range(_ROBUST_ROUNDS):
        sigma = np.maximum(np.median(np.abs(residual), axis=0), min_sigma)
        weights = (np.sqrt(robust_weights) / sigma).T
        coefficients = WeightedNuisance(terms.columns, weights, terms.spread).coefficients(
            weights * without_gravity.T)
        residual = without_gravity - np.tensordot(coefficients, terms.columns, axes=(0, 0)).T
        robust_weights = robust.huber_weights(residual, min_sigma)
    return np.asarray(residual)
