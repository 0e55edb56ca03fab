"""
Criterion of a motion: the evidence of each target against its alternatives in drawn results.

With N the information on a target and its alternatives after the terms of the base are eliminated
(the Schur complement of the posterior's precision) and x the size of the target, the scores of
their coefficients are N_x x plus noise of covariance N. They give the log evidence of each model.
x is drawn from the posterior if the recordings measure it, else from its prior.

The separation of a target in a drawn result is the lead of its evidence over the best other model,
with an alternative or without both. The utility is log(1 + mean log(1 + exp(separation))): it is
logarithmic in the separation, so that one target does not take the whole time. The chance that a
motion resolves a target is the share of results in which its gain and its separation from every
alternative reach the limits of the engine.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.planning.sums import BATCH, Sums
from gravity_comp_ros.regression.gains import shares_left
from gravity_comp_ros.regression.term import Term
import numpy as np

Terms = tuple[Term, ...]
# Number of drawn results.
_DRAWS = 200
# A joint is uncertain if the standard deviation of its gravity exceeds this share of its torque
# scale, and this multiple of the noise of a row.
_MIN_OF_TORQUE, _MIN_OF_NOISE = 0.01, 0.5


@dataclass(frozen=True, eq=False)
class Question:
    """A target's term, the terms of its `base`, and alternatives that replace it."""

    term: Term
    base: Terms
    alternatives: Terms
    sums: Sums

    @property
    def is_measured(self) -> bool:
        """Return whether the term is in the regression of the recordings."""
        return self.term in self.sums.regression.posterior.at

    @property
    def size(self) -> FloatArray:
        """Return the estimate (K,) of a measured size, else its prior standard deviations."""
        posterior = self.sums.regression.posterior
        return posterior.beta[posterior.at[self.term]] if self.is_measured else self.term.prior_std

    def utility(self, marginal: FloatArray) -> FloatArray:
        """Return the utility (C,) of sums of the terms, the shared part eliminated, (C, T, T)."""
        p = self.sums.n_shared
        information = eliminated(marginal, self.sums.at(self.base) - p,
                                 self.sums.at(self._models) - p, self.sums.std[p:])
        separation = np.min(self._separations(information), axis=0)
        return np.asarray(np.log1p(np.logaddexp(0.0, separation).mean(axis=-1)))

    @property
    def _models(self) -> Terms:
        return (self.term, *self.alternatives)

    def _information(self, a: FloatArray, terms: Terms) -> FloatArray:
        """Return the information (K, K) on some terms at sums (L, L), the base eliminated."""
        return eliminated(a[None], self.sums.places(self.base), self.sums.at(terms),
                          self.sums.std)[0]

    def identified(self, a: FloatArray) -> float:
        """Return the share (RMS) of the best coefficient that others leave at sums (L, L)."""
        return float(shares_left(self._information(a, (self.term,)),
                                 np.diag(a)[self.sums.at([self.term])]).max())

    def std(self, a: FloatArray) -> FloatArray:
        """Return the standard deviations (K,) of the coefficients at sums (L, L)."""
        precision = self._information(a, (self.term,)) + np.diag(self.term.prior_std ** -2.0)
        return np.asarray(np.sqrt(np.diag(np.linalg.inv(precision))))

    def untestable(self, motion: Motion, a: FloatArray) -> str:
        """Return why a motion of sums (L, L) does not identify the target, '' if it does."""
        reason, share = self.term.effect.untestable(
            motion, self.term.joint_number), self.identified(a)
        if not reason and share < self.sums.regression.problem.options.min_identified:
            return f'the other terms absorb all but {share:.1%} of its torque'
        return reason or ''

    def chance(self, a: FloatArray) -> tuple[float, Term | None]:
        """
        Return the chance that the target is resolved at sums (L, L), and the closest alternative.

        That has the least separation on average; it is None if that is larger than the gain.
        """
        options = self.sums.regression.problem.options
        gain, *others = self._separations(self._information(a, self._models))
        separation = np.min([gain, *others], axis=0)
        means = [other.mean() for other in others]
        closest = int(np.argmin(means)) if means and min(means) < gain.mean() else None
        return (float(((gain >= options.min_gain) & (separation >= options.margin)).mean()),
                None if closest is None else self.alternatives[closest])

    def _separations(self, information: FloatArray) -> list[FloatArray]:
        """
        Return the gain (..., D) of the target in drawn results, and its lead over alternatives.

        :param information: on target and alternatives, (..., T, T).
        """
        rng, start, evidences = np.random.default_rng(0), 0, []
        score = self._drawn_size(rng) @ information[..., :self.term.n_columns, :]
        score += rng.standard_normal(score.shape[-2:]) @ np.swapaxes(_root(information), -1, -2)
        for term in self._models:
            here = slice(start, start + term.n_columns)
            evidences.append(_evidence(term, information[..., here, here], score[..., here]))
            start = here.stop
        return [evidences[0], *(evidences[0] - other for other in evidences[1:])]

    def _drawn_size(self, rng: np.random.Generator) -> FloatArray:
        """Return drawn coefficients (D, K) of the target."""
        drawn = rng.standard_normal((_DRAWS, self.term.n_columns))
        if self.is_measured:
            posterior = self.sums.regression.posterior
            here = posterior.at[self.term]
            return self.size + drawn @ _root(posterior.covariance[np.ix_(here, here)]).T
        drawn = drawn * self.term.prior_std
        return np.where(self.term.positive, np.abs(drawn), drawn)


@dataclass(frozen=True, eq=False)
class Criterion:
    """
    Utility of sums: that of each question, and that of a smaller uncertainty of gravity.

    `joints` are those whose gravity is uncertain; the mean of ln std over them counts.
    """

    sums: Sums
    questions: tuple[Question, ...]
    joints: tuple[int, ...]

    def utility(self, a: FloatArray) -> FloatArray:
        """Return the utility (C,) of sums (C, L, L)."""
        return np.concatenate([self._utility(a[k:k + BATCH]) for k in range(0, len(a), BATCH)])

    def _utility(self, a: FloatArray) -> FloatArray:
        shared, terms = np.split(np.arange(a.shape[1]), [self.sums.n_shared])
        total = np.zeros(len(a))
        if self.questions:
            marginal = eliminated(a, shared, terms, self.sums.std)
            total += sum(question.utility(marginal) for question in self.questions)
        if self.joints:
            total -= np.log(self.sums.gravity_std(a)[:, list(self.joints)]).mean(axis=1)
        return total


def uncertain_joints(sums: Sums, is_every: bool) -> tuple[int, ...]:
    """
    Return the joints whose gravity the recordings leave uncertain, the most uncertain first.

    :param is_every: whether to return all joints.
    """
    problem, (std,) = sums.regression.problem, sums.gravity_std(sums.recorded[None])
    limit = np.maximum(_MIN_OF_TORQUE * problem.scale.torque,
                       _MIN_OF_NOISE * sums.regression.noise)
    return tuple(n for n in np.argsort(-std).tolist() if is_every or std[n] > limit[n])


def eliminated(a: FloatArray, gone: IntArray, kept: IntArray, std: FloatArray) -> FloatArray:
    """Return the Schur complement (C, K, K) on `kept` with `gone` of their prior eliminated."""
    own, size = a[:, kept[:, None], kept], std[gone]
    # In units of the prior the matrix is at least 1.
    whole = a[:, gone[:, None], gone] * np.outer(size, size) + np.eye(len(gone))
    side = a[:, gone[:, None], kept] * size[:, None]
    return np.asarray(own - side.transpose(0, 2, 1) @ np.linalg.solve(whole, side))


def _evidence(term: Term, information: FloatArray, score: FloatArray) -> FloatArray:
    """Return the log evidence (..., D) of a term for scores (..., D, K) (`regression.gains`)."""
    covariance = np.linalg.inv(information + np.diag(term.prior_std ** -2.0))
    mean = score @ covariance
    spread = np.linalg.slogdet(np.eye(term.n_columns) + information * term.prior_std ** 2)[1]
    evidence = term.log_odds + 0.5 * ((score * mean).sum(axis=-1) - spread[..., None])
    std = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    evidence += term.log_share_allowed(mean, std[..., None, :])
    return np.asarray(evidence)


def _root(matrix: FloatArray) -> FloatArray:
    """Return a factor F (..., K, K) of positive semi-definite matrices, F F'."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])
