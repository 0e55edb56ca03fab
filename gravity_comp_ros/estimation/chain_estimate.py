"""
The chain beside friction, offset and outliers: rough, then settled.

A first search takes all nuisance columns along. Its residual shows how the friction of each joint
turns and which samples are outliers; coefficients that are not told from 0 are dropped. Then the
chain is fitted with what remains, from the axes that were found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.nuisance_columns import fitted_shapes, significant
from gravity_comp_ros.estimation.regression import Regression
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import ChainFit, fit_chain, rough_fit
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
from gravity_comp_ros.models.noise import floor
from gravity_comp_ros.models.sparse.weighted_nuisance import WeightedNuisance
import numpy as np

_ROBUST_ROUNDS = 3
_ROUGH = SearchOptions(starts=24, rivals=0)
_FINAL, _WARM = SearchOptions(), SearchOptions(rivals=0)
# A residual that is not white may hold terms that a wrong minimum had hidden: they are tested
# again so many times.
_REPEATS = 3
# Samples that the search is made on.
_SEARCHED = 250
# Samples that nuisance terms are tested on.
_SETTLED = 600


@dataclass(frozen=True, eq=False)
class ChainEstimate:
    """The fitted chain, and the regression with the terms and trust that it ended with."""

    fit: ChainFit
    regression: Regression

    @property
    def chain(self) -> Chain:
        return self.fit.chain

    @property
    def beside(self) -> FloatArray:
        """Return the coefficients (K,) of `regression.beside()`."""
        return self.fit.nuisance

    @property
    def covariance(self) -> FloatArray:
        """Return the covariance (K, K) of `beside`, gravity fitted beside."""
        return self.fit.nuisance_covariance

    def residual(self) -> FloatArray:
        """Return what gravity and everything beside it leave, (m, N) in N·m."""
        return residual_of(self.fit, self.regression)


def residual_of(fit: ChainFit, regression: Regression) -> FloatArray:
    """Return the residual (m, N) in N·m of a fit with its coefficients beside gravity."""
    return regression.residual(fit.chain.torque(regression.samples.q), fit.nuisance)


def estimate_chain(regression: Regression, known: FloatArray | None = None,
                   start: Chain | None = None, warm: bool = False) -> ChainEstimate:
    """
    Fit a chain beside all that a joint may have.

    :param known: axes (N, 3, 3) that need no search.
    :param start: a chain to begin with.
    :param warm: whether no other starts than that are tried, and no alternatives sought.
    :raises FitError: if there are no samples.
    """
    chain, starts = start, 1
    if chain is None or known is not None or not warm:
        first = _searched(regression.thinned(_SEARCHED), known, start)
        chain, starts = first.chain, first.starts
    regression = _refined(regression, chain)
    every, kept = regression, None
    for _ in range(_REPEATS):
        rough = _settled(every.thinned(_SETTLED), chain, known)
        told = significant(*_of_nuisance(rough, every))
        if told == kept:
            break
        kept, regression = told, every.with_terms(told)
        found = _settled(regression, rough.chain, known, _WARM if warm else _FINAL)
        chain = found.chain
        if (found.inflation == 1.0).all():
            break
    return ChainEstimate(replace(found, starts=starts), regression)


def _searched(regression: Regression, known: FloatArray | None, start: Chain | None) -> ChainFit:
    """
    Return the chain that a search finds, or that of known axes (N, 3, 3).

    Where it is not clean another search has free nuisance terms, and the better of both counts.

    The two have other wrong minima. Both ends are compared with the terms bounded.
    """
    samples, beside = regression.samples, regression.beside()
    if known is not None:
        return fit_chain(samples, _ROUGH, None, known, beside)
    found = rough_fit(samples, _ROUGH, start, beside)
    if found.clean or beside.columns is None:
        return found
    free = rough_fit(samples, _ROUGH, start, replace(beside, spread=None))
    other = rough_fit(samples, None, free.chain, beside)
    return min((found, replace(other, starts=free.starts)),
               key=lambda fit: _log_residual(fit, regression))


def _log_residual(fit: ChainFit, regression: Regression) -> float:
    """Return the mean logarithm of the joints' median residual: each joint in its own units."""
    size = np.median(np.abs(residual_of(fit, regression)), axis=0)
    return float(np.log(np.maximum(size, floor(regression.samples.tau))).mean())


def _settled(regression: Regression, start: Chain, known: FloatArray | None,
             final: SearchOptions | None = None) -> ChainFit:
    """Return the chain that a solver reaches from `start`; with `final` as `fit_chain` does."""
    samples, beside = regression.samples, regression.beside()
    if known is not None:
        return fit_chain(samples, SearchOptions(), None, known, beside)
    if final is None:
        return rough_fit(samples, None, start, beside)
    return fit_chain(samples, final, start, None, beside, search_anew=False)


def _refined(regression: Regression, chain: Chain) -> Regression:
    """Return the regression with directions of motion and trust as the residual shows them."""
    regression = regression.trusting(_left_by(chain, regression))
    recorded = regression.recorded
    if not recorded.qd.any():
        return regression
    # Friction stays in what its shape is read from.
    left = recorded.tau - chain.torque(recorded.q)
    return regression.with_shapes(fitted_shapes(recorded, regression.qdd, left))


def _left_by(chain: Chain, regression: Regression) -> FloatArray:
    """Return what a chain leaves (m, N) after a robust fit of everything beside it, N·m."""
    left = regression.samples.tau - chain.torque(regression.samples.q)
    beside = regression.beside()
    if beside.columns is None:
        return left
    trust, least, residual = np.ones(left.shape), floor(regression.samples.tau), left
    for _ in range(_ROBUST_ROUNDS):
        sigma = np.maximum(np.median(np.abs(residual), axis=0), least)
        weights = (np.sqrt(trust) / sigma).T
        found = WeightedNuisance(beside.columns, weights, beside.spread).coefficients(
            weights * left.T)
        residual = left - np.tensordot(found, beside.columns, axes=(0, 0)).T
        trust = robust.huber_weights(residual, least)
    return np.asarray(residual)


def _of_nuisance(fit: ChainFit, regression: Regression) -> tuple[FloatArray, FloatArray]:
    """Return coefficients and covariance of the nuisance terms, those of effects left out."""
    k = regression.n_effects
    return fit.nuisance[k:], fit.nuisance_covariance[k:, k:]
