"""
Criterion of a motion: the evidence of each target against its alternatives, expected and drawn.

Let M be the information on a target's coefficients and those of an alternative, the terms of the
base eliminated (the Schur complement of the posterior's precision). If the target's size has the
second moments Sigma, the score of coefficients x has the second moments M_xx + M_xt Sigma M_tx, so
that their expected log evidence is, with their prior covariance S,

    1/2 tr((M_xx + S^-1)^-1 (M_xx + M_xt Sigma M_tx)) - 1/2 log |I + M_xx S|.

The separation is that of the target minus that of an alternative, the gain that of the target. The
utility is logarithmic in the smallest of them, so that one target does not take the whole time.

The chance that a chosen motion resolves a target is that of the evidences of the models after it,
for drawn results. The torque of the motion is drawn from the model with the target. A size that
the recordings measure is drawn from its estimate, and their sums are as measured; another one is
drawn from its prior, and so are the sums of the recordings. The target is resolved if its gain and
its separation from every alternative reach the limits of the engine.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, IntArray
from gravity_comp_ros.planning.options import Target
from gravity_comp_ros.planning.sums import Sums
from gravity_comp_ros.regression.gains import shares_left
from gravity_comp_ros.regression.shared import State
from gravity_comp_ros.regression.term import Term
import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import log_ndtr

Terms = tuple[Term, ...]
# Motions that are scored at a time, which bounds the memory.
_BATCH = 32
# Number of drawn results.
_DRAWS = 200
# Poses at which the standard deviation of gravity is evaluated.
_POSES = 300
# A joint is uncertain if the standard deviation of its gravity exceeds this share of its torque
# scale, and this multiple of the noise of a row.
_MIN_OF_TORQUE, _MIN_OF_NOISE = 0.01, 0.5


@dataclass(frozen=True, eq=False)
class Question:
    """
    A target's term, the terms of its `base`, and alternatives that replace it.

    If the recordings contain the term, `mean` (K,) and `moment` (K, K), the second moments of its
    coefficients, are those of the present estimate (`is_measured`), else those of the prior.
    """

    target: Target
    term: Term
    base: Terms
    alternatives: tuple[Term, ...]
    mean: FloatArray
    moment: FloatArray
    is_measured: bool


@dataclass(frozen=True, eq=False)
class GravityQuestion:
    """
    Standard deviation of the gravity torque over the recorded poses (V-optimality).

    `joints` are the uncertain ones, the largest first; `mean_square` (N, P, P) the means over the
    poses of the outer products of the derivatives of a joint's gravity by the shared parameters.
    """

    joints: tuple[int, ...]
    mean_square: FloatArray
    places: IntArray
    std: FloatArray

    @classmethod
    def of(cls, sums: Sums, all_joints: bool) -> GravityQuestion | None:
        """Return the question of a regression; None if no joint is uncertain."""
        regression = sums.planned.regression
        problem = regression.problem
        q = problem.samples.q[evenly_picked(problem.samples.n_samples, _POSES)]
        columns = regression.shared.columns(State(q, 0.0 * q, 0.0 * q))
        square = np.einsum('pni,pnj->nij', columns, columns) / len(q)
        p = columns.shape[2]
        std = _gravity_std(regression.posterior.covariance[None, :p, :p], square)[0]
        limit = np.maximum(_MIN_OF_TORQUE * problem.scale.torque,
                           _MIN_OF_NOISE * regression.noise)
        joints = [int(n) for n in np.argsort(-std) if all_joints or std[n] > limit[n]]
        return cls(tuple(joints), square, sums.with_shared(regression.terms),
                   std) if joints else None

    def std_after(self, sums: Sums, a: FloatArray) -> FloatArray:
        """Return the standard deviations (C, N) in N·m with sums (C, L, L)."""
        here, p = self.places, self.mean_square.shape[1]
        precision = a[:, here[:, None], here] + np.diag(sums.std[here] ** -2.0)
        covariance = np.asarray(np.linalg.inv(precision)[:, :p, :p], dtype=np.float64)
        return _gravity_std(covariance, self.mean_square)


def _gravity_std(covariance: FloatArray, mean_square: FloatArray) -> FloatArray:
    variance = np.einsum('cij,nji->cn', covariance, mean_square, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


@dataclass(frozen=True, eq=False)
class Criterion:
    """Utilities of sums for some questions, the last one gravity."""

    sums: Sums
    questions: tuple[Question, ...]
    gravity: GravityQuestion | None

    @cached_property
    def _open(self) -> IntArray:
        """Return the coefficients that differ between the models that are compared."""
        terms = dict.fromkeys(t for q in self.questions
                              for t in (q.term, *q.alternatives))
        return self.sums.places(tuple(terms))

    @cached_property
    def _common(self) -> IntArray:
        """Return the coefficients of all models but the open ones."""
        terms = dict.fromkeys(t for q in self.questions for t in q.base)
        places = self.sums.with_shared(tuple(terms))
        return places[~np.isin(places, self._open)]

    def utilities(self, a: FloatArray) -> FloatArray:
        """Return the utilities (C, Q) of sums (C, L, L)."""
        return np.concatenate([self._utilities(a[k:k + _BATCH])
                               for k in range(0, len(a), _BATCH)])

    def _utilities(self, a: FloatArray) -> FloatArray:
        utilities = []
        if self.questions:
            marginal = _eliminated(a, self._common, self._open, self.sums.std)
            number = np.full(len(self.sums.std), -1)
            number[self._open] = np.arange(len(self._open))
            utilities = [np.log1p(np.maximum(self._separation(marginal, number, q), 0.0)
                                  / self._needed(q)) for q in self.questions]
        if self.gravity is not None:
            joints = list(self.gravity.joints)
            std = self.gravity.std_after(self.sums, a)[:, joints]
            ratio = self.gravity.std[joints] / np.maximum(std, 1e-12)
            utilities.append(np.log(ratio).mean(axis=1))
        return np.stack(utilities, axis=1)

    def _needed(self, question: Question) -> float:
        """Return the nats that resolve a target."""
        options = self.sums.planned.regression.problem.options
        return options.min_gain + options.margin - question.term.log_odds

    def _separation(self, marginal: FloatArray, number: IntArray,
                    question: Question) -> FloatArray:
        """Return the expected nats (C,) of a target over its closest alternative."""
        places, std = self.sums.places, self.sums.std[self._open]
        own = number[places((question.term,))]
        base = number[places(tuple(t for t in question.base if number[self.sums.at[t][0]] >= 0))]
        others = [number[places((other,))] for other in question.alternatives]
        kept = np.concatenate([own, *others])
        information, size = _eliminated(marginal, base, kept, std), std[kept]
        target = np.arange(len(own))
        gain = smallest = _expected_evidence(information, target, target, question.moment, size)
        start = len(own)
        for other in others:
            here = np.arange(start, start + len(other))
            smallest = np.minimum(smallest, gain - _expected_evidence(
                information, here, target, question.moment, size))
            start += len(other)
        return smallest


def _expected_evidence(information: FloatArray, here: IntArray, target: IntArray,
                       moment: FloatArray, std: FloatArray) -> FloatArray:
    """Return the expected log evidence (C,) of coefficients if the target is present."""
    size = std[here]
    own = information[:, here[:, None], here] * np.outer(size, size)
    side = information[:, here[:, None], target] * size[:, None]
    score = own + side @ moment @ side.transpose(0, 2, 1)
    whole = own + np.eye(len(here))
    explained = np.trace(np.linalg.solve(whole, score), axis1=1, axis2=2)
    return np.asarray(0.5 * explained - 0.5 * np.linalg.slogdet(whole)[1])


def _eliminated(a: FloatArray, gone: IntArray, kept: IntArray, std: FloatArray) -> FloatArray:
    """Return the Schur complement (C, K, K) on `kept` with `gone` of their prior eliminated."""
    own = a[:, kept[:, None], kept]
    if not len(gone):
        return np.asarray(own)
    size = std[gone]
    # In units of the prior the matrix is at least 1.
    whole = a[:, gone[:, None], gone] * np.outer(size, size) + np.eye(len(gone))
    side = a[:, gone[:, None], kept] * size[:, None]
    return np.asarray(own - side.transpose(0, 2, 1) @ np.linalg.solve(whole, side))


def identified(sums: Sums, question: Question, a: FloatArray) -> float:
    """Return the share that all other columns leave of a term's best coefficient (RMS)."""
    own, base = sums.at[question.term], sums.with_shared(question.base)
    information = _eliminated(a[None], base, own, sums.std)[0]
    return float(shares_left(information, np.diag(a)[own]).max())


def coefficients(sums: Sums, places: IntArray, a: FloatArray, b: FloatArray
                 ) -> tuple[FloatArray, FloatArray]:
    """Return posterior mean (K,) and covariance (K, K) of coefficients from sums (L, L), (L,)."""
    size = sums.std[places]
    whole = a[np.ix_(places, places)] * np.outer(size, size) + np.eye(len(places))
    covariance = np.asarray(np.linalg.inv(whole), dtype=np.float64)
    return size * (covariance @ (size * b[places])), covariance * np.outer(size, size)


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
