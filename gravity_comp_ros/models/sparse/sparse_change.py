"""
Which of many numbers changed, and to what: a sparse change under a Gaussian prior.

What was known of P numbers is a mean (the last model) with covariance C. New data, R rows in
units of their noise, see them through a matrix J: r = J.T p + noise, where p is the distance from
the mean. Some of the numbers have jumped, by about an unknown size s:

    p = u + s d,    u ~ N(0, C),    d_k ~ N(0, 1) for k in the support S, else 0.

L1 proposes S: the jump that minimises 1/2 |J.T s d - r|^2 + lambda |d|_1 by ADMM (Yu 2022, Eqs.
8-14). Then numbers leave and join S one by one as the evidence p(r | S, s) asks, which prices a
jump that the data could do without. How many jump is not known either: any number of the K is as
likely, and then any of the supports with that many, so that a change that is everywhere costs no
more than one that is in a few places.

Where the data do not settle S, one support would be too sure of itself: the final mean and
covariance are averages over supports and sizes drawn from their posterior (Gibbs sampling).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.models.sparse import admm
import numpy as np
from scipy import linalg, special

# Sizes of a jump that are tried, as shares of the largest.
_SIZES = (1.0, 0.3, 0.1, 0.03)
_MAX_STEPS = 400
# Draws of the sampler: coordinates visited before and while supports are counted.
_BURN_IN, _DRAWS = 100, 500


@dataclass(frozen=True, eq=False)
class ChangeProblem:
    """
    What changed, given new data.

    :param columns: J (P, R), one row for each number, in units of the noise.
    :param residual: r (R,), measured minus what the mean predicts, in units of the noise.
    :param covariance: C (P, P).
    :param may_change: K of the P numbers.
    :param size: how far a number may jump at most.
    :param along: directions (L, P) along which many numbers may jump together, the largest of
        each 1. They count as numbers that may change, after the others.
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
        """Return which of the P numbers jump with a support (K + L,)."""
        return np.flatnonzero(self.jumps[support].any(axis=0))


@dataclass(frozen=True, eq=False)
class Change:
    """
    The posterior of p (P,) on the most likely support, its log evidence; ADMM's run.

    `share` is the likeliest size of a jump, as a share of the largest; `single` are the numbers
    that jump by themselves, `along` (L,) masks the directions of the support.
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
    Return the posterior of p on the support and the size that are likeliest.

    :param near: the change of a problem that differs little; the search starts from it.
    """
    lasso, support, best = _likeliest(problem, near)
    mean, covariance = best.posterior(support)
    return _change(problem, support, best, mean, covariance, lasso)


def average_change(problem: ChangeProblem, near: Change | None = None, seed: int = 0) -> Change:
    """Return the posterior of p over all supports and sizes, with the likeliest support."""
    lasso, support, best = _likeliest(problem, near)
    mean, covariance = _sample(problem, support, best, np.random.default_rng(seed))
    return _change(problem, support, best, mean, covariance, lasso)


def _change(problem: ChangeProblem, support: BoolArray, best: _Evidence, mean: FloatArray,
            covariance: FloatArray, lasso: admm.AdmmResult) -> Change:
    log_evidence = best.score(support) - 0.5 * float(problem.residual @ problem.residual)
    count = len(problem.may_change)
    return Change(mean, covariance, problem.numbers(support), log_evidence, lasso, best.share,
                  problem.may_change[support[:count]], support[count:])


def full_evidence(problem: ChangeProblem) -> float:
    """Return the log evidence of a change of all numbers that may change, of the largest size."""
    every = _Evidence(problem, _SIZES[0])
    return every.score(np.ones(len(problem.jumps), dtype=bool)) - 0.5 * float(
        problem.residual @ problem.residual)


def propose(problem: ChangeProblem) -> tuple[admm.AdmmResult, BoolArray]:
    """Return ADMM's solution of the L1 problem, and which of the K numbers it moves."""
    columns = problem.jumps @ problem.columns
    lengths = np.linalg.norm(columns, axis=1)
    seen = lengths > 1e-9 * max(float(lengths.max(initial=0.0)), 1e-300)
    unit = columns[seen] / lengths[seen, None]
    count = len(unit)
    start = admm.AdmmState(np.zeros(count), np.zeros(count), admm.AdmmOptions().rho)
    lam = np.sqrt(2.0 * np.log(max(count, 2)))
    found = admm.solve(unit @ unit.T, unit @ problem.residual, np.full(count, lam), start)
    moved = np.zeros(len(seen), dtype=bool)
    moved[seen] = found.state.z != 0.0
    return found, moved


def _likeliest(problem: ChangeProblem, near: Change | None = None
               ) -> tuple[admm.AdmmResult, BoolArray, _Evidence]:
    if near is not None:
        best = _Evidence(problem, near.share)
        start = np.concatenate([np.isin(problem.may_change, near.single), near.along])
        return near.lasso, best.settle(start), best
    lasso, proposed = propose(problem)
    best = _Evidence(problem, _SIZES[0])
    support = max((best.settle(start) for start in (proposed, np.ones_like(proposed))),
                  key=best.score)
    for share in _SIZES[1:]:
        other = _Evidence(problem, share)
        settled = other.settle(support)
        if other.score(settled) > best.score(support):
            best, support = other, settled
    return lasso, support, best


def _sample(problem: ChangeProblem, support: BoolArray, start: _Evidence,
            rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance over supports and sizes, by Gibbs sampling."""
    sizes = [_Evidence(problem, share) for share in _SIZES]
    at = next(k for k, each in enumerate(sizes) if each.share == start.share)
    counts: dict[tuple[int, bytes], int] = {}
    for draw in range(_BURN_IN + _DRAWS):
        k = int(rng.integers(len(support) + 1)) if len(support) else 0
        if k == len(support):
            scores = np.array([each.score(support) for each in sizes])
            at = int(rng.choice(len(sizes), p=special.softmax(scores)))
        elif rng.random() < special.expit(sizes[at].gains(support)[k]):
            support = _toggled(support, k)
        if draw >= _BURN_IN:
            key = (at, support.tobytes())
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
        known = _square_root(problem.covariance)
        jumps = share * problem.size * problem.jumps.T
        count = jumps.shape[1]
        self.n_known = known.shape[1]
        self.w = np.hstack([known, jumps])
        seen = self.w.T @ problem.columns
        self.b = seen @ problem.residual
        self.precision = seen @ seen.T + np.eye(len(seen))
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
        """Return by how much `score` rises when each of the K numbers leaves or joins (K,)."""
        active = self._active(support)
        inverse = linalg.inv(self.precision[np.ix_(active, active)], check_finite=False)
        z = inverse @ self.b[active]
        gains = np.empty(len(support))
        inside = np.arange(self.n_known, len(active))
        diagonal = inverse[inside, inside]
        gains[support] = -0.5 * z[inside] ** 2 / diagonal - 0.5 * np.log(diagonal)
        outside = self.n_known + np.flatnonzero(~support)
        cross = self.precision[np.ix_(active, outside)]
        rest = self.precision[outside, outside] - np.einsum('ij,ij->j', cross, inverse @ cross)
        left = self.b[outside] - cross.T @ z
        gains[~support] = 0.5 * left ** 2 / rest - 0.5 * np.log(rest)
        count = int(support.sum())
        return gains + np.where(support, self.log_prior[count - 1],
                                self.log_prior[min(count + 1, len(support))]
                                ) - self.log_prior[count]

    def settle(self, support: BoolArray) -> BoolArray:
        """Let numbers leave or join one by one, as long as that is likelier."""
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
        return np.concatenate([np.arange(self.n_known),
                               self.n_known + np.flatnonzero(support)])


def _toggled(support: BoolArray, k: int) -> BoolArray:
    other = support.copy()
    other[k] = not other[k]
    return other


def _square_root(covariance: FloatArray) -> FloatArray:
    """Return L with L L.T = covariance; numbers that are known exactly cost nothing."""
    vague = np.flatnonzero(np.diag(covariance) > 0.0)
    values, vectors = np.linalg.eigh(covariance[np.ix_(vague, vague)])
    kept = values > 1e-14 * max(float(values.max(initial=0.0)), 1e-300)
    root = np.zeros((len(covariance), int(kept.sum())))
    root[vague] = vectors[:, kept] * np.sqrt(values[kept])
    return root
