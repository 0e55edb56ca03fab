"""
The one criterion: the log evidence of a term given the others.

With u the score of a term's coefficients and M their information, both after the other
coefficients are eliminated, S their prior covariance and kappa >= 1 an inflation of the noise,

    gain = 1/2 u' (M + kappa S^-1)^-1 u / kappa - 1/2 log |I + M S / kappa| + log odds.

kappa is the larger of two inflations. One is the scatter of the term's own scores over blocks of
time, relative to that of the noise: an error that repeats with the motion scatters more. The other
is the error of the laws of terms that hold the same joint at rest, which the term could have the
shape of. The noise in M and u contains the discrepancy and the autocorrelation of the residual
already (`noise`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.regression.design import Pool
from gravity_comp_ros.regression.posterior import Posterior, solve
from gravity_comp_ros.regression.term import (
    Term, total_std, uncorrected, with_children_of)
import numpy as np
from scipy.special import erfc

# Share of a column below which the others explain it already, whatever its coefficient.
_EXPLAINED = 3e-3
# Sum of squares of a column, relative to the largest of its term, that is 0 but for the rounding
# of the axes.
_ZERO = 1e-12
# Number of settings of a kind of term with the same nonlinear parameters, the best at kappa = 1,
# whose gain is computed.
_SETTINGS = 2


@dataclass(frozen=True, eq=False)
class Score:
    """
    A term outside of a posterior: information M (K, K), score u (K,) and mean (K,).

    `own` (K, K) is the information if all other columns were 0; `sides` are its weighted products
    with the columns of the posterior on each joint.
    """

    term: Term
    information: FloatArray
    score: FloatArray
    mean: FloatArray
    own: FloatArray
    sides: Mapping[int, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, term: Term, information: FloatArray, score: FloatArray, own: FloatArray,
           sides: Mapping[int, FloatArray]) -> Score:
        """Return a score whose information has errors of rounding."""
        information = _semidefinite(0.5 * (information + information.T))
        mean = np.linalg.solve(information + np.diag(term.prior_std ** -2.0), score)
        return cls(term, information, score, np.asarray(mean), own, sides)

    @property
    def unabsorbed(self) -> float:
        """Return the share of the term's torque (RMS) that the columns of other terms leave."""
        return float(np.sqrt(max(np.trace(self.information), 0.0)
                             / max(float(np.trace(self.own)), 1e-300)))

    @property
    def identified(self) -> FloatArray:
        """Return the share (K,) of each coefficient's torque (RMS) that other columns leave."""
        return shares_left(self.information, np.diag(self.own))

    def share_left(self, beta: FloatArray) -> float:
        """Return the share of the torque (RMS) at coefficients (K,) that other terms leave."""
        rest, whole = (float(beta @ each @ beta) for each in (self.information, self.own))
        return float(np.sqrt(max(rest, 0.0) / max(whole, 1e-300)))


def shares_left(information: FloatArray, size: FloatArray) -> FloatArray:
    """
    Return the share (K,) of the RMS of each column that all other columns leave.

    :param information: that of the K columns after the others are eliminated, (K, K).
    :param size: the sums of squares of the columns, (K,), weighted as in `information`.
    """
    shares = np.zeros(len(size))
    # Rounding leaves a column that is 0, such as that of the moment about a vertical axis.
    used = np.flatnonzero(size > _ZERO * max(float(size.max(initial=0.0)), 1e-300))
    scale = np.sqrt(size[used])
    # In units of the columns the smallest number is far below any share that counts.
    scaled = information[np.ix_(used, used)] / np.outer(scale, scale) + 1e-12 * np.eye(len(used))
    inverse = np.diag(np.linalg.inv(scaled))
    # Rounding may make the information of a column that the others explain negative.
    shares[used] = np.sqrt(np.where(inverse > 0.0, 1.0 / inverse, 0.0))
    return shares


def score_of(posterior: Posterior, term: Term) -> Score:
    """Return the score of a term whose coefficients are 0 in the posterior, or not in it."""
    k, design, sides = term.n_columns, posterior.design, {}
    side, own, score = np.zeros((k, len(posterior.beta))), np.zeros((k, k)), np.zeros(k)
    for j in term.joints(design.n_joints):
        w, z = posterior.precision[j], design.weighted(j, term)
        sides[j] = w * (z @ design.x[j].T)[:, posterior.columns(j)]
        side[:, posterior.places(j)] += sides[j]
        own += w * (z @ z.T)
        score += w * (z @ posterior.residual(j))
    return Score.of(term, own - side @ posterior.covariance @ side.T, score, own, sides)


def _semidefinite(matrix: FloatArray) -> FloatArray:
    """Return a symmetric matrix without the negative eigenvalues of rounding."""
    if len(matrix) == 1:
        return np.maximum(matrix, 0.0)
    values, vectors = np.linalg.eigh(matrix)
    if values[0] >= 0.0:
        return matrix
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def gain_of(posterior: Posterior, term: Term, kappa: float | None = None) -> float:
    """
    Return the gain of a term whose coefficients are 0 in the posterior, or not in it.

    :param kappa: the inflation of the noise; that of the term itself by default.
    """
    return _gain_if_independent(posterior, score_of(posterior, term), kappa)


def _gain_if_independent(posterior: Posterior, scored: Score,
                         kappa: float | None = None) -> float:
    return -np.inf if scored.unabsorbed < _EXPLAINED else gain(posterior, scored, kappa)


def gain(posterior: Posterior, scored: Score, kappa: float | None = None) -> float:
    """Return the gain of a scored term."""
    term, prior = scored.term, np.diag(scored.term.prior_std ** -2.0)
    kappa = inflation(posterior, scored) if kappa is None else kappa
    return (_gain_of_columns(scored, kappa) + term.log_prior
            + log_share_allowed(term, scored.mean, scored.information / kappa + prior))


def _gain_of_columns(scored: Score, kappa: float) -> float:
    """Return the gain without the prior odds and signs."""
    std = scored.term.prior_std
    information, score = scored.information / kappa, scored.score / kappa
    explained = 0.5 * float(score @ np.linalg.solve(information + np.diag(std ** -2.0), score))
    spread = np.eye(len(score)) + information * std ** 2
    return explained - 0.5 * float(np.linalg.slogdet(spread)[1])


def gain_together(posterior: Posterior, terms: Sequence[Term]) -> float:
    """
    Return the gain at kappa = 1 of several terms of one joint together.

    :param posterior: with coefficients of 0 for these terms, or without them.
    """
    scored = score_of(posterior, replace(
        terms[0], columns=np.concatenate([term.columns for term in terms], axis=1),
        prior_std=total_std(terms)))
    covariance = np.linalg.inv(scored.information + np.diag(scored.term.prior_std ** -2.0))
    total, start = _gain_of_columns(scored, 1.0), 0
    for term in terms:
        here = slice(start, start + term.n_columns)
        total += term.log_prior + log_share_allowed(
            term, scored.mean[here], np.linalg.inv(covariance[here, here]))
        start = here.stop
    return total


def log_share_allowed(term: Term, mean: FloatArray, precision: FloatArray) -> float:
    """Return `Term.log_share_allowed` of coefficients (K,) with a precision (K, K)."""
    if not term.positive.any():
        return 0.0
    return float(term.log_share_allowed(mean, np.sqrt(np.diag(np.linalg.inv(precision)))))


def inflation(posterior: Posterior, scored: Score) -> float:
    """Return kappa of a scored term, 1 at least."""
    return max(1.0, _scatter(posterior, scored), _law_inflation(posterior, scored.term))


def _law_inflation(posterior: Posterior, term: Term) -> float:
    """Return the inflation by the error of the laws of other terms that hold the same joint."""
    design, j = posterior.design, term.joint_number
    if not term.holds_a_joint:
        return 1.0
    squares = sum(float(posterior.squares_of(other)[j]) for other in posterior.terms
                  if other.joint == term.joint and other.holds_a_joint
                  and other not in posterior.absent)
    return 1.0 + design.law_error ** 2 * float(posterior.precision[j]) * squares


def _scatter(posterior: Posterior, scored: Score) -> float:
    """Return the variance of a term's scores over blocks, relative to that of the noise."""
    design, term = posterior.design, scored.term
    block = design.rows.block
    total = np.zeros((int(block.max(initial=0)) + 1, term.n_columns))
    for j, side in scored.sides.items():
        places = posterior.places(j)
        covariance = posterior.covariance[np.ix_(places, places)]
        own = design.weighted(j, term) - posterior.torque(j, side @ covariance)
        error = posterior.precision[j] * (posterior.residual(j) - scored.mean @ own)
        for k in range(term.n_columns):
            total[:, k] += np.bincount(block, own[k] * error, len(total))
    information = scored.information
    ridge = np.diag(1e-9 * term.prior_std ** -2.0
                    + 1e-12 * np.trace(information)) + information
    return float(np.trace(np.linalg.solve(ridge, total.T @ total))) / term.n_columns


def without_weak(posterior: Posterior, is_removable: Callable[[Term], bool],
                 least: float) -> Posterior:
    """
    Return a posterior without removable terms whose gain is below the least one, weakest first.

    The evidence of several terms has no inflation of the noise, the gain of one has.
    """
    while removable := [term for term in uncorrected(posterior.terms) if is_removable(term)]:
        gains = [gain_of(posterior.without((term,)), term) for term in removable]
        if min(gains) >= least:
            break
        posterior = solve(posterior.design, with_children_of(
            posterior.terms, removable[int(np.argmin(gains))]), posterior.precision)
    return posterior


class Ranking:
    """
    Candidates of a pool in order of falling gain, those above `least` alone.

    The gain at kappa = 1 is computed for all candidates at once; the gain itself only as far as
    it can decide. With kappa > 1 a gain above half the number of columns falls (its derivative by
    kappa is negative), so the former is an upper bound of every gain that a term can be selected
    for.
    """

    def __init__(self, posterior: Posterior, pool: Pool, allowed: Sequence[int],
                 least: float) -> None:
        self.posterior, self.pool, self.least = posterior, pool, least
        self.allowed = np.asarray(allowed, dtype=np.int64)
        self.bounds = _bounds(posterior, pool)[self.allowed]

    def __iter__(self) -> Iterator[tuple[float, Term]]:
        """Yield gain and term of every candidate above the least gain, the best first."""
        order = self._best_settings()
        waiting: list[tuple[float, int]] = []
        for place, k in enumerate(order):
            scored = _PoolScores.of(self.posterior, self.pool).scored(
                self.posterior, self.pool, self.allowed[k])
            waiting.append((_gain_if_independent(self.posterior, scored), k))
            waiting.sort(key=lambda each: -each[0])
            following = self.bounds[order[place + 1]] if place + 1 < len(order) else -np.inf
            while waiting and waiting[0][0] >= following:
                value, best = waiting.pop(0)
                if value > self.least:
                    yield value, self.pool.terms[self.allowed[best]]

    def _best_settings(self) -> list[int]:
        """Return the candidates above the least gain, the best settings of each effect."""
        order, seen = [], Counter[tuple[object, ...]]()
        for k in np.argsort(-self.bounds):
            if self.bounds[k] <= self.least:
                break
            term = self.pool.terms[self.allowed[k]]
            kind = term.kind, tuple(term.setting)
            seen[kind] += 1
            if seen[kind] <= _SETTINGS:
                order.append(int(k))
        return order


@dataclass(frozen=True, eq=False)
class _PoolScores:
    """
    Scores of all C columns of a pool's candidates outside of a posterior.

    `score` (C,), `information` and `own` (T, K, K) by K as in `Score`; `solved` (C, P) are the
    products with the P columns of the posterior times their covariance.
    """

    score: FloatArray
    information: Mapping[int, FloatArray]
    own: Mapping[int, FloatArray]
    solved: FloatArray

    @classmethod
    def of(cls, posterior: Posterior, pool: Pool) -> _PoolScores:
        """Return the scores, from those of the posterior that another one conditions."""
        if pool not in posterior.of_pool:
            posterior.of_pool[pool] = cls._conditioned(
                cls.of(posterior.conditioned[0], pool), *posterior.conditioned, pool
            ) if posterior.conditioned else cls._summed(posterior, pool)
        scores: _PoolScores = posterior.of_pool[pool]
        return scores

    def scored(self, posterior: Posterior, pool: Pool, number: int) -> Score:
        """Return the score of one candidate."""
        size, here = pool.terms[number].n_columns, slice(*pool.start[number:number + 2])
        place = int(np.searchsorted(pool.groups[size], number))
        return Score.of(
            pool.terms[number], self.information[size][place], self.score[here],
            self.own[size][place],
            {j: posterior.precision[j] * pool.side(j)[here, posterior.columns(j)]
             for j in pool.joints})

    @classmethod
    def _summed(cls, posterior: Posterior, pool: Pool) -> _PoolScores:
        score, side = np.zeros(int(pool.start[-1])), np.zeros((pool.start[-1],
                                                               len(posterior.beta)))
        own = {size: np.zeros((len(group), size, size)) for size, group in pool.groups.items()}
        for j in pool.joints:
            w, places = posterior.precision[j], posterior.places(j)
            part = w * pool.side(j)[:, posterior.columns(j)]
            side[:, places] += part
            score += w * pool.cross[j] - part @ posterior.beta[places]
            for size, products in own.items():
                products += w * pool.own[j, size]
        used = np.unique(np.concatenate([posterior.places(j) for j in pool.joints]))
        solved = side[:, used] @ posterior.covariance[used]
        return cls(score, {size: products - _within(pool, size, solved[:, used], side[:, used])
                           for size, products in own.items()}, own, solved)

    @classmethod
    def _conditioned(cls, known: _PoolScores, base: Posterior, here: IntArray,
                     pool: Pool) -> _PoolScores:
        """Return the scores with the coefficients `here` of a posterior conditioned to 0."""
        side = known.solved[:, here]
        change = side @ np.linalg.inv(base.covariance[np.ix_(here, here)])
        return cls(known.score + change @ base.beta[here], {
            size: information + _within(pool, size, change, side)
            for size, information in known.information.items()}, known.own, known.solved[:, :0])


def _within(pool: Pool, size: int, one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the products (T, K, K) of two arrays (C, P) within each candidate of K columns."""
    places = pool.places[size]
    return np.asarray(one[places] @ other[places].swapaxes(1, 2))


def _bounds(posterior: Posterior, pool: Pool) -> FloatArray:
    """Return the largest gains at kappa = 1 (T,) of the candidates of a pool."""
    bounds, scores = np.empty(len(pool.terms)), _PoolScores.of(posterior, pool)
    for size, group in pool.groups.items():
        information, score = scores.information[size], scores.score[pool.places[size]]
        independent = np.trace(information, axis1=1, axis2=2) > _EXPLAINED ** 2 * np.trace(
            scores.own[size], axis1=1, axis2=2)
        std = pool.prior_std[size]
        prior = std[:, :, None] ** -2.0 * np.eye(size)
        mean = np.linalg.solve(information + prior, score[:, :, None])[:, :, 0]
        occam = np.linalg.slogdet(np.eye(size) + information * std[:, None] ** 2)[1]
        value = (0.5 * (score * mean).sum(axis=1) - 0.5 * occam + pool.log_odds[group]
                 + pool.most_share_allowed[group])
        bounds[group] = np.where(independent, value, -np.inf)
    return bounds


def p_of(gain: float) -> float:
    """Return the p-value of a likelihood ratio of `gain` nats with one degree of freedom."""
    return float(erfc(np.sqrt(max(gain, 0.0))))
