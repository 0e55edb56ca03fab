"""Other models that are nearly as probable: with another term instead of one, or with one more."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.regression.gains import gain_of, score_of
from gravity_comp_ros.regression.posterior import Posterior
from gravity_comp_ros.regression.search import Search
from gravity_comp_ros.regression.term import is_consistent, Key, Term, with_children_of
import numpy as np
from scipy.special import expit

# Number of draws of a posterior, which resolves a share of 1/e to the power of the margin.
_DRAWS = 100
# Share of a term's gain that an alternative must reach to be tried.
_COMPARABLE = 0.2


@dataclass(frozen=True)
class Alternative:
    """A term that could replace another one: the log evidence and the posterior with it."""

    log_evidence: float
    term: Term
    posterior: Posterior


def alternatives(search: Search, term: Term) -> list[Alternative]:
    """
    Return other terms on any joint that could replace one, the most probable first.

    Each kind of term with a comparable gain has its best setting.
    """
    without = search.posterior.without((term,))
    rest = with_children_of(search.terms, term)
    own = gain_of(without, term)
    minimum = max(search.options.min_gain, _COMPARABLE * own)
    chosen: dict[tuple[object, ...], tuple[float, Term]] = {}
    for pool in search.pools:
        for gain, other in search.ranking(without, pool, rest, minimum):
            if other.key != term.key and gain > chosen.get(other.kind, (-np.inf,))[0]:
                chosen[other.kind] = gain, other
    needed = own - search.options.near
    return _replacing(search, term, [search.refined(without, other, needed)[0]
                                     for _, other in chosen.values()])


def excluded_alternatives(search: Search, term: Term) -> list[Alternative]:
    """Return the untestable effects of its joint that could replace a term, likewise."""
    return _replacing(search, term, [other for other in search.candidates.excluded
                                     if other.joint == term.joint])


def covariance_of_omitted(search: Search) -> FloatArray:
    """
    Return the covariance (K, K) of the selected coefficients by terms that are not selected.

    The evidence for viscous friction may be too small to select it; Coulomb friction then contains
    it. A term at its best setting is present with the probability of its gain. With it the
    coefficients differ by -C B' b, C their covariance, B the products of its columns with theirs
    and b its coefficients.
    """
    posterior, seen = search.posterior, set[Key]()
    total = np.zeros_like(posterior.covariance)
    for pool in search.pools:
        for gain, term in search.ranking(posterior, pool, search.terms, -search.options.margin):
            if term.key in seen:
                continue
            seen.add(term.key)
            scored = score_of(posterior, term)
            products = np.zeros((term.n_columns, len(posterior.beta)))
            for j, side in scored.sides.items():
                products[:, posterior.places(j)] += side
            square = np.outer(scored.mean, scored.mean) + np.linalg.inv(
                scored.information + np.diag(term.prior_std ** -2.0))
            change = posterior.covariance @ products.T
            total += float(expit(gain)) * change @ square @ change.T
    return total


def _replacing(search: Search, term: Term, others: Iterable[Term]) -> list[Alternative]:
    results = []
    for other in others:
        terms = search.exchanged(term, other)
        if not is_consistent(terms):
            continue
        trial = search.solved(terms)
        if trial.log_evidence > search.posterior.log_evidence - search.options.near:
            trial = max(trial, search.with_refined(trial, {other.joint}, from_compared=True),
                        key=lambda each: each.log_evidence)
        at = next(t for t in trial.terms if t.key == other.key)
        results.append(Alternative(trial.log_evidence + _log_share_plausible(trial, at),
                                   at, trial))
    return sorted(results, key=lambda each: -each.log_evidence)


def _log_share_plausible(posterior: Posterior, term: Term) -> float:
    """
    Return the logarithm of the share of a term's posterior that is physical, from draws.

    Signs are in the evidence already (`gains`): it is the share of draws of the right signs.
    """
    if not term.effect.has_limits:
        return 0.0
    here = posterior.at[term]
    draws = np.random.default_rng(0).multivariate_normal(
        posterior.beta[here], posterior.covariance[np.ix_(here, here)], _DRAWS, method='eigh')
    draws = draws[(draws[:, term.positive] >= 0.0).all(axis=1)]
    plausible = sum(term.effect.implausible(draw, term.setting) is None for draw in draws)
    return float(np.log((plausible + 1.0) / (len(draws) + 1.0)))
