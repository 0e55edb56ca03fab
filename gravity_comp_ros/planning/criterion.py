"""
Criterion of a motion: the evidence of each target against its alternatives.

Let M be the information on a target's coefficients and those of an alternative, the terms of the
base eliminated (the Schur complement of the posterior's precision). If the target's size has the
second moments Sigma, the score of coefficients x has the second moments M_xx + M_xt Sigma M_tx, so
that their expected log evidence is, with their prior covariance S,

    1/2 tr((M_xx + S^-1)^-1 (M_xx + M_xt Sigma M_tx)) - 1/2 log |I + M_xx S|.

The separation is that of the target minus that of an alternative, the gain that of the target. The
utility is logarithmic in the smallest of them, so that one target does not take the whole time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, IntArray
from gravity_comp_ros.planning.options import Target
from gravity_comp_ros.planning.sums import Sums
from gravity_comp_ros.regression.gains import shares_left
from gravity_comp_ros.regression.shared import State
from gravity_comp_ros.regression.term import Term
import numpy as np

Terms = tuple[Term, ...]
# Motions that are scored at a time, which bounds the memory.
_BATCH = 32
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


def total(sums: Sums, added: Sequence[FloatArray]) -> FloatArray:
    """Return the sums (L, L) of the recordings and of some paths."""
    return np.asarray(sum(added, sums.recorded))
