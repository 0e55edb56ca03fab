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
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.planning.options import POSES, Target
from gravity_comp_ros.planning.sums import BATCH, Sums
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.gains import shares_left
from gravity_comp_ros.regression.shared import State
from gravity_comp_ros.regression.term import Term
import numpy as np
from scipy.special import log_ndtr

Terms = tuple[Term, ...]
# Number of drawn results.
_DRAWS = 200
# A joint is uncertain if the standard deviation of its gravity exceeds this share of its torque
# scale, and this multiple of the noise of a row.
_MIN_OF_TORQUE, _MIN_OF_NOISE = 0.01, 0.5


@dataclass(frozen=True)
class Chance:
    """
    Chance that a target is resolved, with medians in nats of its gain and its separation.

    `closest` is the alternative with the least separation on average, None if there is none.
    """

    chance: float
    gain: float
    separation: float
    closest: Term | None


@dataclass(frozen=True, eq=False)
class Question:
    """A target's term, the terms of its `base`, and alternatives that replace it."""

    target: Target
    term: Term
    base: Terms
    alternatives: Terms
    sums: Sums

    @cached_property
    def is_measured(self) -> bool:
        """Return whether the recordings contain the term."""
        regression, (*_, evidence) = self.sums.regression, self._now
        gain = evidence - _solved(self.sums, self.base, self.sums.recorded, self.sums.score)[2]
        return (self.term.key not in regression.candidates.untestable
                and float(gain) >= regression.problem.options.min_gain)

    @cached_property
    def size(self) -> FloatArray:
        """Return the estimate (K,) of a measured size, else its prior standard deviations."""
        mean: FloatArray = self._now[0][-self.term.n_columns:]
        return mean if self.is_measured else self.term.prior_std

    def utility(self, marginal: FloatArray) -> FloatArray:
        """Return the utility (C,) of sums of the terms, the shared part eliminated, (C, T, T)."""
        options, first = self.sums.regression.problem.options, self.sums.n_shared
        models = [self.sums.at([term]) - first for term in (self.term, *self.alternatives)]
        kept = np.concatenate(models)
        information = eliminated(marginal, self.sums.at(self.base) - first, kept,
                                 self.sums.std[first:])
        ends = np.cumsum([len(model) for model in models])
        gain, *others = (self._expected(information, np.arange(end - len(model), end),
                                        self.sums.std[first:][model])
                         for model, end in zip(models, ends))
        smallest = np.min([gain, *(gain - other for other in others)], axis=0)
        needed = options.min_gain + options.margin - self.term.log_odds
        return np.asarray(np.log1p(np.maximum(smallest, 0.0) / needed))

    def _expected(self, information: FloatArray, here: IntArray, std: FloatArray) -> FloatArray:
        """Return the expected log evidence (C,) of coefficients if the target is present."""
        own = information[:, here[:, None], here] * np.outer(std, std)
        side = information[:, here, :self.term.n_columns] * std[:, None]
        score = own + side @ self._moment @ side.transpose(0, 2, 1)
        whole = own + np.eye(len(here))
        explained = np.trace(np.linalg.solve(whole, score), axis1=1, axis2=2)
        return np.asarray(0.5 * explained - 0.5 * np.linalg.slogdet(whole)[1])

    @cached_property
    def _moment(self) -> FloatArray:
        """Return the second moments (K, K) of the size."""
        if not self.is_measured:
            return np.diag(self.size ** 2)
        k = self.term.n_columns
        return np.outer(self.size, self.size) + self._now[1][-k:, -k:]

    def identified(self, a: FloatArray) -> float:
        """Return the share (RMS) of the best coefficient that others leave at sums (L, L)."""
        own, base = self.sums.at([self.term]), self.sums.places(self.base)
        information = eliminated(a[None], base, own, self.sums.std)[0]
        return float(shares_left(information, np.diag(a)[own]).max())

    def std(self, a: FloatArray) -> FloatArray:
        """Return the standard deviations (K,) of the coefficients at sums (L, L)."""
        _, covariance, _ = _solved(self.sums, self._with_term, a, self.sums.score)
        return np.sqrt(np.diag(covariance)[-self.term.n_columns:])

    def untestable(self, motion: Motion, a: FloatArray) -> str:
        """Return why a motion of sums (L, L) does not identify the target, '' if it does."""
        reason, share = self.term.effect.untestable(
            motion, self.term.joint_number), self.identified(a)
        if not reason and share < self.sums.regression.problem.options.min_identified:
            return f'the other terms absorb all but {share:.1%} of its torque'
        return reason or ''

    def after(self, added: FloatArray) -> Chance:
        """Return the chance with the recordings and a motion of sums (L, L)."""
        sums, options = self.sums, self.sums.regression.problem.options
        a, b = sums.recorded + added, self._drawn(added)
        own, without, *others = (_solved(sums, terms, a, b)[2] for terms in (
            self._with_term, self.base, *((*self.base, t) for t in self.alternatives)))
        gain, separations = own - without, [own - other for other in others]
        separation = np.min([gain, *separations], axis=0)
        closest = min(zip(separations, self.alternatives), key=lambda each: each[0].mean(),
                      default=(gain, None))
        return Chance(float(((gain >= options.min_gain) & (separation >= options.margin)).mean()),
                      float(np.median(gain)), float(np.median(separation)),
                      closest[1] if closest[0].mean() < gain.mean() else None)

    def _drawn(self, added: FloatArray) -> FloatArray:
        """Return drawn products (D, L) of the columns with the torque."""
        sums, rng, places = self.sums, np.random.default_rng(0), self.sums.places(self._with_term)
        drawn = rng.standard_normal((_DRAWS, len(places)))
        if self.is_measured:
            mean, covariance, _ = self._now
            drawn = mean + drawn @ _root(covariance).T
            start, products = sums.score, added
        else:
            drawn[:, :-self.term.n_columns] = 0.0
            drawn[:, -self.term.n_columns:] *= self.term.prior_std
            if self.term.effect.why_not_negative:
                drawn = np.abs(drawn)
            start, products = 0.0 * sums.score, sums.recorded + added
        noise = rng.standard_normal((_DRAWS, len(start))) @ _root(products).T
        return np.asarray(start + drawn @ products[places] + noise)

    @property
    def _with_term(self) -> Terms:
        return (*self.base, self.term)

    @cached_property
    def _now(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return _solved(self.sums, self._with_term, self.sums.recorded, self.sums.score)


@dataclass(frozen=True, eq=False)
class Gravity:
    """
    Standard deviation of the gravity torque over the recorded poses (V-optimality).

    `joints` are the uncertain ones, the largest first; `mean_square` (N, P, P) the means over the
    poses of the outer products of the derivatives of a joint's gravity by the shared parameters;
    `now` (N,) the present standard deviations in N·m.
    """

    sums: Sums
    mean_square: FloatArray
    now: FloatArray
    joints: tuple[int, ...]

    @classmethod
    def of(cls, regression: Regression, all_joints: bool) -> Gravity | None:
        """Return the question of a regression; None if no joint is uncertain."""
        problem = regression.problem
        q = problem.samples.q[evenly_picked(problem.samples.n_samples, POSES)]
        columns = regression.shared.columns(State(q, 0.0 * q, 0.0 * q))
        sums = Sums(regression, regression.terms, 0.0)
        columns = columns @ sums.root
        square = np.einsum('pni,pnj->nij', columns, columns) / len(q)
        std = cls(sums, square, np.zeros(0), ()).std(sums.recorded[None])[0]
        limit = np.maximum(_MIN_OF_TORQUE * problem.scale.torque,
                           _MIN_OF_NOISE * regression.noise)
        joints = [int(n) for n in np.argsort(-std) if all_joints or std[n] > limit[n]]
        return cls(sums, square, std, tuple(joints)) if joints else None

    def std(self, a: FloatArray) -> FloatArray:
        """Return the standard deviations (C, N) in N·m at sums (C, L, L)."""
        here, p = self.sums.places(self.sums.regression.terms), self.sums.n_shared
        precision = a[:, here[:, None], here] + np.diag(self.sums.std[here] ** -2.0)
        variance = np.einsum('cij,nji->cn', np.linalg.inv(precision)[:, :p, :p],
                             self.mean_square, optimize=True)
        return np.asarray(np.sqrt(np.maximum(variance, 1e-24)))

    def utility(self, a: FloatArray) -> FloatArray:
        """Return the utility (C,) of sums (C, L, L)."""
        return np.asarray(-np.log(self.std(a)[:, list(self.joints)]).mean(axis=1))


@dataclass(frozen=True, eq=False)
class Criterion:
    """Utilities of sums for some questions, the last one gravity."""

    sums: Sums
    questions: tuple[Question, ...]
    gravity: Gravity | None

    def utilities(self, a: FloatArray) -> FloatArray:
        """Return the utilities (C, Q) of sums (C, L, L)."""
        return np.concatenate([self._utilities(a[k:k + BATCH])
                               for k in range(0, max(len(a), 1), BATCH)])

    def _utilities(self, a: FloatArray) -> FloatArray:
        shared, terms = np.split(np.arange(a.shape[1]), [self.sums.n_shared])
        utilities = []
        if self.questions:
            marginal = eliminated(a, shared, terms, self.sums.std)
            utilities = [question.utility(marginal) for question in self.questions]
        if self.gravity is not None:
            utilities.append(self.gravity.utility(a))
        return np.stack(utilities, axis=1)


def eliminated(a: FloatArray, gone: IntArray, kept: IntArray, std: FloatArray) -> FloatArray:
    """Return the Schur complement (C, K, K) on `kept` with `gone` of their prior eliminated."""
    own, size = a[:, kept[:, None], kept], std[gone]
    # In units of the prior the matrix is at least 1.
    whole = a[:, gone[:, None], gone] * np.outer(size, size) + np.eye(len(gone))
    side = a[:, gone[:, None], kept] * size[:, None]
    return np.asarray(own - side.transpose(0, 2, 1) @ np.linalg.solve(whole, side))


def _solved(sums: Sums, terms: Terms, a: FloatArray, b: FloatArray
            ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return posterior mean (…, K), covariance (K, K) and log evidence (…,) of a model.

    :param terms: those of the model, after the shared part.
    :param a: sums (L, L). :param b: scores (…, L).
    """
    places = sums.places(terms)
    size = sums.std[places]
    scale = np.outer(size, size)
    covariance = np.linalg.inv(a[np.ix_(places, places)] * scale + np.eye(len(places)))
    score = b[..., places] * size
    mean = np.asarray(score @ covariance)
    evidence = (0.5 * (score * mean).sum(axis=-1) + 0.5 * np.linalg.slogdet(covariance)[1]
                + sum(term.log_odds for term in terms))
    # Priors of positive coefficients are cut at 0 (`gains.log_share_allowed`).
    cut = np.flatnonzero(sums.positive[places])
    evidence = evidence + (log_ndtr(mean[..., cut] / np.sqrt(np.diag(covariance)[cut]))
                           + np.log(2.0)).sum(axis=-1)
    return mean * size, np.asarray(covariance * scale), np.asarray(evidence)


def _root(matrix: FloatArray) -> FloatArray:
    """Return a factor F of a positive semi-definite matrix, F F'."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
