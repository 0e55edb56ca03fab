"""
Which few of many numbers changed, and to what: a sparse change under a Gaussian prior.

What was known of P numbers is a mean (the last model) with covariance C. New data, R rows in
units of their noise, see them through a matrix J: r = J.T p + noise, where p is the distance from
the mean. Some of the numbers may have jumped, by up to about a known size s, and few of them did:

    p = u + s d,    u ~ N(0, C),    d_k ~ N(0, 1) for k in the support S, else 0.

L1 proposes S: the jump that minimises 1/2 |J.T s d - r|^2 + lambda |d|_1 by ADMM (Yu 2022, Eqs.
8-14). Then numbers leave and join S one by one as the evidence p(r | S) asks, which prices a jump
that the data could do without. Supports that are nearly as likely as the best are averaged with
their posterior probabilities, and the covariance holds the spread between them.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.gravity import admm
from gravity_comp_ros.samples import BoolArray, FloatArray, IntArray
import numpy as np
from scipy import linalg

# Supports with a posterior ratio of up to 1 to 400 are averaged.
_TIE = 6.0
_MAX_STEPS = 400


@dataclass(frozen=True)
class ChangeProblem:
    """
    What changed, given new data.

    :param columns: J (P, R), one row for each number, in units of the noise.
    :param residual: r (R,), measured minus what the mean predicts, in units of the noise.
    :param covariance: C (P, P).
    :param may_change: K of the P numbers.
    :param size: s (K,), how far each may jump.
    :param log_odds: (K,) for a jump against none, before any data.
    :param likely: mask (K,) of a support to start from, beside the one that L1 proposes.
    """

    columns: FloatArray
    residual: FloatArray
    covariance: FloatArray
    may_change: IntArray
    size: FloatArray
    log_odds: FloatArray
    likely: BoolArray


@dataclass(frozen=True)
class Change:
    """The posterior of p (P,), the most likely support, its log evidence; ADMM's run."""

    mean: FloatArray
    covariance: FloatArray
    support: IntArray
    log_evidence: float
    ties: int
    lasso: admm.AdmmResult


def find_change(problem: ChangeProblem) -> Change:
    """Return the posterior of a sparse change (module docstring)."""
    search = _Evidence(problem)
    lasso, proposed = propose(problem)
    settled = [search.settle(start) for start in (proposed, problem.likely)]
    best = max(settled, key=search.score)
    mean, covariance, ties = search.average(best)
    log_evidence = search.score(best) - 0.5 * float(problem.residual @ problem.residual)
    return Change(mean, covariance, problem.may_change[best], log_evidence, ties, lasso)


def propose(problem: ChangeProblem) -> tuple[admm.AdmmResult, BoolArray]:
    """Return ADMM's solution of the L1 problem, and which of the K numbers it moves."""
    columns = problem.columns[problem.may_change] * problem.size[:, None]
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


class _Evidence:
    """
    Evidence and posterior for any support.

    With C = L L.T and W = [L, s e_k ...], p = W z for standard normal z, and the posterior of z
    on the active columns of W has precision B = I + W.T J J.T W and mean B^-1 W.T J r.
    """

    def __init__(self, problem: ChangeProblem) -> None:
        known = _square_root(problem.covariance)
        jumps = np.zeros((len(known), len(problem.may_change)))
        jumps[problem.may_change, np.arange(len(problem.may_change))] = problem.size
        self.n_known = known.shape[1]
        self.w = np.hstack([known, jumps])
        seen = self.w.T @ problem.columns
        self.b = seen @ problem.residual
        self.precision = seen @ seen.T + np.eye(len(seen))
        self.log_odds = problem.log_odds

    def score(self, support: BoolArray) -> float:
        """Return the log evidence of a support, without -|r|^2 / 2, which all supports share."""
        active = self._active(support)
        factor = linalg.cholesky(self.precision[np.ix_(active, active)], lower=True,
                                 check_finite=False)
        half = linalg.solve_triangular(factor, self.b[active], lower=True, check_finite=False)
        return float(0.5 * half @ half - np.log(np.diag(factor)).sum()
                     + self.log_odds[support].sum())

    def gains(self, support: BoolArray) -> FloatArray:
        """Return by how much `score` rises when each of the K numbers leaves or joins (K,)."""
        active = self._active(support)
        inverse = linalg.inv(self.precision[np.ix_(active, active)], check_finite=False)
        z = inverse @ self.b[active]
        gains = np.empty(len(support))
        inside = np.arange(self.n_known, len(active))
        diagonal = inverse[inside, inside]
        gains[support] = (-0.5 * z[inside] ** 2 / diagonal - 0.5 * np.log(diagonal)
                          - self.log_odds[support])
        outside = self.n_known + np.flatnonzero(~support)
        cross = self.precision[np.ix_(active, outside)]
        rest = self.precision[outside, outside] - np.einsum('ij,ij->j', cross, inverse @ cross)
        left = self.b[outside] - cross.T @ z
        gains[~support] = 0.5 * left ** 2 / rest - 0.5 * np.log(rest) + self.log_odds[~support]
        return gains

    def settle(self, support: BoolArray) -> BoolArray:
        """Let numbers leave or join one by one, as long as that is likelier."""
        for _ in range(_MAX_STEPS):
            gains = self.gains(support)
            k = int(np.argmax(gains))
            if gains[k] <= 1e-9:
                break
            support = _toggled(support, k)
        return support

    def average(self, best: BoolArray) -> tuple[FloatArray, FloatArray, int]:
        """Return mean and covariance over the best support and those that nearly tie."""
        gains = self.gains(best)
        near = np.flatnonzero(gains > -_TIE)
        weights = np.exp(np.concatenate([[0.0], gains[near]]))
        weights /= weights.sum()
        posteriors = [self.posterior(s) for s in [best] + [_toggled(best, int(k)) for k in near]]
        means = np.array([mean for mean, _ in posteriors])
        spread = means - weights @ means
        covariance = np.tensordot(weights, np.array([c for _, c in posteriors]), axes=(0, 0))
        return weights @ means, covariance + (spread.T * weights) @ spread, len(near)

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
