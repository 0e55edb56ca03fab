"""
Published covariance of all coefficients, shared ones and those of terms.

It is that of the posterior and of three errors that the posterior does not contain:

- a term that is not selected may be present (`alternatives.covariance_of_omitted`);
- no law is exact. The law of a term has an error of a share of its torque (RMS), of any shape. An
  error of the torque of variance V on each row changes the coefficients by C X' W e, so that their
  covariance grows by C X' W V W X C, with C their covariance, X the columns and W the weights;
- an alternative may be the right one, with the probability of its evidence.

The error of a static law is an error of its coefficients, and none of the static torque: in the
fitted motion the torque with these coefficients is that of the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.regression.alternatives import Alternative, covariance_of_omitted
from gravity_comp_ros.regression.posterior import Posterior
from gravity_comp_ros.regression.search import Search
from gravity_comp_ros.regression.term import Key, Term
import numpy as np
from scipy.special import softmax


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """
    The `covariance` (K, K) of the shared coefficients, then those of the terms.

    `stds` are by the key of a term the standard deviations of its coefficients, `size_stds` that
    of a common factor of them, whose estimate is 1. Both are those if no alternative is right,
    with the error of the term's own law: Coulomb and viscous friction are parts of one law.
    """

    covariance: FloatArray
    stds: Mapping[Key, FloatArray]
    size_stds: Mapping[Key, float]


def uncertainty_of(search: Search, posterior: Posterior,
                   others: Mapping[Key, Sequence[Alternative]]) -> Uncertainty:
    """
    Return the published covariance.

    :param posterior: that of the selected terms at the published noise.
    :param others: the alternatives of each term.
    """
    omitted = covariance_of_omitted(search)[np.ix_(*2 * [_order(search.posterior, posterior)])]
    certain = posterior.covariance + omitted
    shapes = law_covariances(posterior)
    laws = {term: np.tensordot(posterior.squares_of(term), shapes, 1) for term in posterior.terms}
    stds, size_stds = {}, {}
    for term, at in posterior.at.items():
        own, beta = (certain + laws[term])[np.ix_(at, at)], posterior.beta[at]
        stds[term.key] = np.sqrt(np.diag(own))
        size_stds[term.key] = float(beta @ np.linalg.solve(own, beta)) ** -0.5
    steps = _steps_to_others(search, posterior, others)
    moving = sum(law for term, law in laws.items() if not term.effect.is_static)
    return Uncertainty(certain + moving + steps.T @ steps, stds, size_stds)


def _order(of: Posterior, posterior: Posterior) -> IntArray:
    """Return the numbers of the coefficients of a posterior among those of another one."""
    at = {term.key: here for term, here in of.at.items()}
    return np.concatenate([np.arange(posterior.design.n_shared),
                           *(at[term.key] for term in posterior.terms)])


def law_covariances(posterior: Posterior) -> FloatArray:
    """
    Return the covariances (N, K, K) of all coefficients by the errors of laws, by joint.

    They are those of a law whose weighted torque on that joint has a sum of squares of 1.
    """
    design, covariance = posterior.design, posterior.covariance
    result = np.zeros((design.n_joints, *covariance.shape))
    for j in range(design.n_joints):
        columns, side = posterior.columns(j), covariance[:, posterior.places(j)]
        result[j] = ((posterior.precision[j] * design.law_error) ** 2
                     * side @ design.gram[j][np.ix_(columns, columns)] @ side.T)
    return result


def _steps_to_others(search: Search, posterior: Posterior,
                     others: Mapping[Key, Sequence[Alternative]]) -> FloatArray:
    """Return the changes (A, K) to the alternatives, times the root of their probability."""
    chosen = search.posterior
    pairs = [(term, other) for term in chosen.terms for other in others[term.key]]
    evidence = np.array([chosen.log_evidence, *(other.log_evidence for _, other in pairs)])
    steps = np.zeros((len(pairs), len(chosen.beta)))
    for step, (term, other) in zip(steps, pairs):
        _fill_step(step, chosen, term, other)
    return np.asarray(np.sqrt(softmax(evidence)[1:, None])
                      * steps[:, _order(chosen, posterior)])


def _fill_step(step: FloatArray, chosen: Posterior, replaced: Term, other: Alternative) -> None:
    """
    Write the change (K,) of all coefficients from the chosen terms to an alternative.

    A static term that replaces another one counts as that part of it which has the same torque:
    where gravity absorbs both, the prediction is their sum with gravity.
    """
    p, its = chosen.design.n_shared, other.posterior
    by_key = {term.key: term for term in its.terms}
    step[:p] = its.beta[:p] - chosen.beta[:p]
    for term, at in chosen.at.items():
        instead = by_key.get(term.key)
        if instead is None and term.holds_a_joint and other.term.holds_a_joint and (
                term.key == replaced.key and term.joint == other.term.joint):
            instead = other.term
        step[at] = -chosen.beta[at]
        if instead is not None:
            step[at] += _same_torque(term, instead, its.beta[its.at[instead]])


def _same_torque(term: Term, other: Term, beta: FloatArray) -> FloatArray:
    """Return the coefficients (K,) of a term nearest to the torque of another one."""
    if term.columns is other.columns:
        return beta
    columns, target = (each.columns.reshape(-1, each.n_columns) for each in (term, other))
    return lstsq(columns, target @ beta)
