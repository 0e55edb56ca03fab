"""
Chance that a motion resolves a target: the evidences of the models after it, for drawn results.

The torque of the motion is drawn from the model with the target. A size that the recordings
measure is drawn from its estimate, and their sums are as measured; another one is drawn from its
prior, and so are the sums of the recordings. The target is resolved if its gain and its separation
from every alternative reach the limits of the engine.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.planning.criterion import coefficients, Question
from gravity_comp_ros.planning.sums import Sums
from gravity_comp_ros.regression.term import Term
import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import log_ndtr

# Number of drawn results.
_DRAWS = 200


@dataclass(frozen=True)
class Evidence:
    """Gain and separation (D,) in nats of drawn results; `closest` is an alternative, or None."""

    gain: FloatArray
    separation: FloatArray
    closest: Term | None

    def chance(self, min_gain: float, margin: float) -> float:
        """Return the share of the results that resolve the target."""
        return float(((self.gain >= min_gain) & (self.separation >= margin)).mean())


def evidence_after(sums: Sums, question: Question, added: FloatArray) -> Evidence:
    """
    Return the evidence of a target with the recordings and a motion.

    :param added: the sums (L, L) of the motion.
    """
    a = sums.recorded + added
    b = _drawn_scores(sums, question, added)
    base = question.base
    own = _log_evidence(sums, (*base, question.term), a, b)
    gain = own - _log_evidence(sums, base, a, b)
    others = [_log_evidence(sums, (*base, other), a, b) for other in question.alternatives]
    if not others:
        return Evidence(gain, gain, None)
    best = int(np.argmax([other.mean() for other in others]))
    separation = own - np.max(others, axis=0)
    closest = question.alternatives[best] if separation.mean() < gain.mean() else None
    return Evidence(gain, np.minimum(separation, gain), closest)


def _drawn_scores(sums: Sums, question: Question, added: FloatArray) -> FloatArray:
    """Return drawn products (D, L) of the columns with the torque."""
    rng, term = np.random.default_rng(0), question.term
    places = sums.with_shared((*question.base, term))
    own = np.arange(len(places) - term.n_columns, len(places))
    drawn = np.zeros((_DRAWS, len(places)))
    if question.is_measured:
        mean, covariance = coefficients(sums, places, sums.recorded, sums.score)
        drawn = mean + rng.standard_normal(drawn.shape) @ _root(covariance).T
        size = _allowed(term, drawn[:, own])
        shift = (size - drawn[:, own]) @ np.linalg.solve(
            covariance[np.ix_(own, own)], covariance[own])
        drawn, start, products = drawn + shift, sums.score, added
    else:
        drawn[:, own] = _allowed(term, term.prior_std * rng.standard_normal(
            (_DRAWS, len(own))))
        start, products = np.zeros_like(sums.score), sums.recorded + added
    noise = rng.standard_normal((_DRAWS, len(start))) @ _root(products).T
    return np.asarray(start + drawn @ products[places] + noise)


def _allowed(term: Term, size: FloatArray) -> FloatArray:
    return np.abs(size) if term.effect.why_not_negative else size


def _root(matrix: FloatArray) -> FloatArray:
    """Return a factor F of a positive semi-definite matrix, F F'."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _log_evidence(sums: Sums, terms: tuple[Term, ...], a: FloatArray, b: FloatArray
                  ) -> FloatArray:
    """Return the log evidence (D,) of terms with sums (L, L) and scores (D, L)."""
    places = sums.with_shared(terms)
    size = sums.std[places]
    factor = cholesky(a[np.ix_(places, places)] * np.outer(size, size) + np.eye(len(places)),
                      lower=True)
    white = solve_triangular(factor, (b[:, places] * size).T, lower=True)
    result = (0.5 * (white ** 2).sum(axis=0) - np.log(np.diag(factor)).sum()
              + sum(term.log_odds for term in terms))
    return np.asarray(result + _log_share_allowed(terms, factor, white))


def _log_share_allowed(terms: tuple[Term, ...], factor: FloatArray, white: FloatArray
                       ) -> FloatArray:
    """Return the log evidence (D,) that priors of positive coefficients add (`gains`)."""
    signed: list[IntArray] = []
    start = len(factor) - sum(term.n_columns for term in terms)
    for term in terms:
        if term.effect.why_not_negative:
            signed.append(np.arange(start, start + term.n_columns))
        start += term.n_columns
    if not signed:
        return np.zeros(white.shape[1])
    here = np.concatenate(signed)
    inverse = solve_triangular(factor, np.eye(len(factor)), lower=True)[:, here]
    ratio = (inverse.T @ white) / np.sqrt((inverse ** 2).sum(axis=0))[:, None]
    return np.asarray((log_ndtr(ratio) + np.log(2.0)).sum(axis=0))
