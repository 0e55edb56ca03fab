"""
Sparse change of parameters under a Gaussian prior.

The prior of P parameters is a mean (the previous model) with covariance C. New data are R rows in
units of their noise with the Jacobian J: r = J.T p + noise, where p is the deviation from the
mean. Some of the parameters have jumped, by a common unknown size s:

    p = u + s d,    u ~ N(0, C),    d_k ~ N(0, 1) for k in the support S, else 0.

L1 proposes S: the jump that minimises 1/2 |J.T s d - r|^2 + lambda |d|_1 by ADMM (Yu 2022, Eqs.
8-14). Then parameters leave and join S one by one while that raises the evidence p(r | S, s),
which penalises unnecessary jumps. The number of jumps is unknown: every number up to K has the
same prior probability, and so has every support of that size, so a change of all parameters costs
at most as much as one of a few.

A single support would underestimate the uncertainty where the data do not determine S. So the
final mean and covariance are averages over supports and sizes drawn from their posterior (Gibbs
sampling).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.models.sparse import admm
import numpy as np
from scipy import linalg, special

# Sizes of a jump, as shares of the largest.
_SIZES = (1.0, 0.3, 0.1, 0.03)
_MAX_STEPS = 400
# Number of Gibbs steps discarded and used.
_BURN_IN, _DRAWS = 100, 500


@dataclass(frozen=True, eq=False)
class ChangeProblem:
    """
    Estimation of a change from new data.

    :param columns: J (P, R), one row for each parameter, in units of the noise.
    :param residual: r (R,), measured minus predicted from the mean, in units of the noise.
    :param covariance: C (P, P).
    :param may_change: indices of the K parameters that may change.
    :param size: largest size of a jump.
    :param along: directions (L, P) of common jumps of several parameters, the largest component of
        each 1. They count as parameters that may change, after the others.
    """

    columns: FloatArray
    residual: FloatArray
    covariance: FloatArray
    may_change: IntArray
    size: float
    along: FloatArray | None = None

    @cached_property
    def jumps(self) -> FloatArray:
        """Return the directions (K + L, P) of all jumps."""
        single = np.zeros((len(self.may_change), len(self.columns)))
        single[np.arange(len(self.may_change)), self.may_change] = 1.0
        return single if self.along is None else np.concatenate([single, self.along])

    def numbers(self, support: BoolArray) -> IntArray:
        """Return the indices of the parameters that jump with a support (K + L,)."""
        return np.flatnonzero(self.jumps[support].any(axis=0))


@dataclass(frozen=True, eq=False)
class Change:
    """
    The posterior of p (P,), its most probable support with its log evidence, and ADMM's result.

    `share` is the most probable size of a jump, as a share of the largest; `single` are the
    parameters that jump separately, `along` (L,) masks the directions of the support.
    """

    mean: FloatArray
    covariance: FloatArray
    support: IntArray
    log_evidence: float
    lasso: admm.AdmmResult
    share: float
    single: IntArray
    along: BoolArray


def find_change(problem: ChangeProblem, near: Change | None = None) -> Change:
    """
    Return the posterior of p on the most probable support and size.

    :param near: the change of a similar problem, from which the search starts.
    """
    lasso, support, best = _most_probable(problem, near)
    mean, covariance = best.posterior(support)
    return _change(problem, support, best, mean, covariance, lasso)


def average_change(problem: ChangeProblem, near: Change | None = None, seed: int = 0) -> Change:
    """Return the posterior of p over all supports and sizes, with the most probable support."""
    lasso, support, best = _most_probable(problem, near)
    mean, covariance = _sample(problem, support, best, np.random.default_rng(seed))
    return _change(problem, support, best, mean, covariance, lasso)


def _change(problem: ChangeProblem, support: BoolArray, best: _Evidence, mean: FloatArray,
            covariance: FloatArray, lasso: admm.AdmmResult) -> Change:
    log_evidence = best.score(support) - 0.5 * float(problem.residual @ problem.residual)
    count = len(problem.may_change)
    return Change(mean, covariance, problem.numbers(support), log_evidence, lasso, best.share,
                  problem.may_change[support[:count]], support[count:])


def full_evidence(problem: ChangeProblem) -> float:
    """Return the log evidence of a change of all parameters that may change, of largest size."""
    evidence = _Evidence(problem, _SIZES[0])
    return evidence.score(np.ones(len(problem.jumps), dtype=bool)) - 0.5 * float(
        problem.residual @ problem.residual)


def propose(problem: ChangeProblem) -> tuple[admm.AdmmResult, BoolArray]:
    """Return ADMM's solution of the L1 problem, and the mask (K + L,) of its support."""
    columns = problem.jumps @ problem.columns
    lengths = np.linalg.norm(columns, axis=1)
    excited = lengths > 1e-9 * max(float(lengths.max(initial=0.0)), 1e-300)
    unit = columns[excited] / lengths[excited, None]
    count = len(unit)
    start = admm.AdmmState(np.zeros(count), np.zeros(count), admm.AdmmOptions().rho)
    lam = np.sqrt(2.0 * np.log(max(count, 2)))
    result = admm.solve(unit @ unit.T, unit @ problem.residual, np.full(count, lam), start)
    support = np.zeros(len(excited), dtype=bool)
    support[excited] = result.state.z != 0.0
    return result, support


def _most_probable(problem: ChangeProblem, near: Change | None = None
                   ) -> tuple[admm.AdmmResult, BoolArray, _Evidence]:
    if near is not None:
        best = _Evidence(problem, near.share)
        start = np.concatenate([np.isin(problem.may_change, near.single), near.along])
        return near.lasso, best.maximised(start), best
    lasso, proposed = propose(problem)
    best = _Evidence(problem, _SIZES[0])
    support = max((best.maximised(start) for start in (proposed, np.ones_like(proposed))),
                  key=best.score)
    for share in _SIZES[1:]:
        other = _Evidence(problem, share)
        candidate = other.maximised(support)
        if other.score(candidate) > best.score(support):
            best, support = other, candidate
    return lasso, support, best


def _sample(problem: ChangeProblem, support: BoolArray, start: _Evidence,
            rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance over supports and sizes, by Gibbs sampling."""
    sizes = [_Evidence(problem, share) for share in _SIZES]
    at = next(k for k, each in enumerate(sizes) if each.share == start.share)
    # Most draws return to a few supports, whose probabilities are computed once.
    joins: dict[tuple[int, bytes], FloatArray] = {}
    sized: dict[bytes, FloatArray] = {}
    counts: dict[tuple[int, bytes], int] = {}
    for draw in range(_BURN_IN + _DRAWS):
        k = int(rng.integers(len(support) + 1)) if len(support) else 0
        key = at, support.tobytes()
        if k == len(support):
            if key[1] not in sized:
                sized[key[1]] = special.softmax([each.score(support) for each in sizes])
            at = int(rng.choice(len(sizes), p=sized[key[1]]))
        else:
            if key not in joins:
                joins[key] = special.expit(sizes[at].gains(support))
            if rng.random() < joins[key][k]:
                support = _toggled(support, k)
        if draw >= _BURN_IN:
            key = at, support.tobytes()
            counts[key] = counts.get(key, 0) + 1
    posteriors = [sizes[k].posterior(np.frombuffer(mask, dtype=bool)) for k, mask in counts]
    weights = np.array(list(counts.values())) / _DRAWS
    means = np.array([mean for mean, _ in posteriors])
    mean = weights @ means
    covariance = np.tensordot(weights, np.array([c for _, c in posteriors]), axes=(0, 0))
    return mean, covariance + ((means - mean).T * weights) @ (means - mean)


class _Evidence:
    """
    Evidence and posterior for any support, for one size of a jump.

    With C = L L.T and W = [L, s e_k ...], p = W z for standard normal z, and the posterior of z
    on the active columns of W has precision B = I + W.T J J.T W and mean B^-1 W.T J r.
    """

    def __init__(self, problem: ChangeProblem, share: float) -> None:
        self.share = share
        prior = _square_root(problem.covariance)
        jumps = share * problem.size * problem.jumps.T
        count = jumps.shape[1]
        self.n_prior = prior.shape[1]
        self.w = np.hstack([prior, jumps])
        rows = self.w.T @ problem.columns
        self.b = rows @ problem.residual
        self.precision = rows @ rows.T + np.eye(len(rows))
        # ln p(S) for any S with 0 to K members: 1 / (K + 1) over the number of such supports.
        sizes = np.arange(count + 1)
        self.log_prior = -np.log(count + 1.0) - (
            special.gammaln(count + 1) - special.gammaln(sizes + 1)
            - special.gammaln(count - sizes + 1))

    def score(self, support: BoolArray) -> float:
        """Return ln p(r, S | s), without -|r|^2 / 2, which all supports share."""
        active = self._active(support)
        factor = linalg.cholesky(self.precision[np.ix_(active, active)], lower=True,
                                 check_finite=False)
        half = linalg.solve_triangular(factor, self.b[active], lower=True, check_finite=False)
        return float(0.5 * half @ half - np.log(np.diag(factor)).sum()
                     + self.log_prior[support.sum()])

    def gains(self, support: BoolArray) -> FloatArray:
        """Return the increase of `score` when each of the K parameters leaves or joins (K,)."""
        active = self._active(support)
        inverse = linalg.inv(self.precision[np.ix_(active, active)], check_finite=False)
        z = inverse @ self.b[active]
        gains = np.empty(len(support))
        inside = np.arange(self.n_prior, len(active))
        diagonal = inverse[inside, inside]
        gains[support] = -0.5 * z[inside] ** 2 / diagonal - 0.5 * np.log(diagonal)
        outside = self.n_prior + np.flatnonzero(~support)
        cross = self.precision[np.ix_(active, outside)]
        # The prior alone is 1; rounding of exact data may leave less.
        precision = np.maximum(self.precision[outside, outside] - np.einsum(
            'ij,ij->j', cross, inverse @ cross), 1.0)
        residual = self.b[outside] - cross.T @ z
        gains[~support] = 0.5 * residual ** 2 / precision - 0.5 * np.log(precision)
        count = int(support.sum())
        return gains + np.where(support, self.log_prior[count - 1],
                                self.log_prior[min(count + 1, len(support))]
                                ) - self.log_prior[count]

    def maximised(self, support: BoolArray) -> BoolArray:
        """Return the support after parameters left or joined one by one while `score` rises."""
        for _ in range(_MAX_STEPS if len(support) else 0):
            gains = self.gains(support)
            k = int(np.argmax(gains))
            if gains[k] <= 1e-9:
                break
            support = _toggled(support, k)
        return support

    def posterior(self, support: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (P,) and covariance (P, P) of p on a support."""
        active = self._active(support)
        inverse = linalg.inv(self.precision[np.ix_(active, active)], check_finite=False)
        w = self.w[:, active]
        return w @ (inverse @ self.b[active]), w @ inverse @ w.T

    def _active(self, support: BoolArray) -> IntArray:
        return np.concatenate([np.arange(self.n_prior),
                               self.n_prior + np.flatnonzero(support)])


def _toggled(support: BoolArray, k: int) -> BoolArray:
    other = support.copy()
    other[k] = not other[k]
    return other


def _square_root(covariance: FloatArray) -> FloatArray:
    """Return L with L L.T = covariance, without columns for exactly known parameters."""
    uncertain = np.flatnonzero(np.diag(covariance) > 0.0)
    values, vectors = np.linalg.eigh(covariance[np.ix_(uncertain, uncertain)])
    kept = values > 1e-14 * max(float(values.max(initial=0.0)), 1e-300)
    root = np.zeros((len(covariance), int(kept.sum())))
    root[uncertain] = vectors[:, kept] * np.sqrt(values[kept])
    return root
