"""Posterior of the coefficients of a set of terms, and its evidence."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.regression.design import Design
from gravity_comp_ros.regression.term import Term, total_std
import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.linalg.lapack import dpotri


@dataclass(frozen=True, eq=False)
class Posterior:
    """
    Mean `beta` (K,) and covariance (K, K) of the shared coefficients, then those of `terms`.

    `precision` (N,) is the weight of a squared residual of each joint, 1 / (N·m)^2: the inverse
    of the noise variance times its inflation by autocorrelation and discrepancy.
    """

    design: Design
    terms: tuple[Term, ...]
    precision: FloatArray
    beta: FloatArray
    covariance: FloatArray
    # The posterior of which some coefficients (K,) are conditioned to 0 (`without`), and the terms
    # of these coefficients.
    conditioned: tuple[Posterior, IntArray] | None = None
    absent: tuple[Term, ...] = ()
    _places: dict[int, tuple[IntArray, IntArray]] = field(default_factory=dict)
    _residuals: dict[int, FloatArray] = field(default_factory=dict, init=False)
    of_pool: dict[object, Any] = field(default_factory=dict, init=False)  # scores of candidates

    @cached_property
    def at(self) -> dict[Term, IntArray]:
        """Return the numbers of the coefficients of each term."""
        places, start = {}, self.design.n_shared
        for term in self.terms:
            places[term] = np.arange(start, start + term.n_columns)
            start += term.n_columns
        return places

    def _of(self, j: int) -> tuple[IntArray, IntArray]:
        """Return the coefficients that act on a joint, and their columns of the design."""
        if j not in self._places:
            acting = [t for t in self.terms if j in t.joints(self.design.n_joints)]
            places = np.concatenate([np.arange(self.design.n_shared),
                                     *(self.at[t] for t in acting)])
            self._places[j] = places, self.design.selected(j, acting)
        return self._places[j]

    def places(self, j: int) -> IntArray:
        """Return the numbers of the coefficients that act on a joint, in the design's order."""
        return self._of(j)[0]

    def columns(self, j: int) -> IntArray:
        """Return the design's columns of these coefficients."""
        return self._of(j)[1]

    def torque(self, j: int, coefficients: FloatArray) -> FloatArray:
        """Return the columns that act on a joint times coefficients (..., K), (..., R)."""
        every = np.zeros((*coefficients.shape[:-1], len(self.design.x[j])))
        every[..., self.columns(j)] = coefficients
        return np.asarray(every @ self.design.x[j])

    def residual(self, j: int) -> FloatArray:
        """Return the weighted residual (R,) of a joint."""
        if j not in self._residuals:
            self._residuals[j] = self.design.y[j] - self.torque(j, self.beta[self.places(j)])
        return self._residuals[j]

    def unweighted_residual(self) -> FloatArray:
        """Return the residual of all joints, (R, N) in N·m."""
        parts = [self.residual(j) for j in range(self.design.n_joints)]
        return np.asarray(np.stack(parts, axis=1) / np.maximum(self.design.root.T, 1e-9))

    def squares_of(self, term: Term) -> FloatArray:
        """Return the sum of squares of the weighted torque of a term, by joint, (N,)."""
        result, beta = np.zeros(self.design.n_joints), self.beta[self.at[term]]
        for j in term.joints(self.design.n_joints):
            here = self.design.selected(j, (term,))[self.design.n_shared:]
            result[j] = beta @ self.design.gram[j][np.ix_(here, here)] @ beta
        return result

    @cached_property
    def squares(self) -> FloatArray:
        """Return the sum of squared residuals of each joint, (N,) in (N·m)^2."""
        result = np.empty(self.design.n_joints)
        for j in range(self.design.n_joints):
            beta = np.zeros(len(self.design.cross[j]))
            beta[self.columns(j)] = self.beta[self.places(j)]
            result[j] = (self.design.square[j] - 2.0 * beta @ self.design.cross[j]
                         + beta @ self.design.gram[j] @ beta)
        # Rounding of the difference of large sums.
        return np.maximum(result, 1e-14 * self.design.square)

    @cached_property
    def likelihood_and_odds(self) -> float:
        """Return the logarithm of likelihood and prior odds at the mean, up to a constant."""
        return float(-0.5 * (self.precision @ self.squares) + sum(t.log_prior for t in self.terms))

    @cached_property
    def log_evidence(self) -> float:
        """Return the log evidence of the terms at this precision, up to a constant."""
        prior, std = self.design.prior, np.ones(len(self.beta))
        std[self.design.n_shared:] = total_std(self.terms)
        scaled = self.covariance / np.outer(std, std)
        return float(self.likelihood_and_odds - 0.5 * (self.from_prior() ** 2).sum()
                     + 0.5 * (np.linalg.slogdet(scaled)[1] + prior.log_det)
                     + sum(float(t.log_share_allowed(self.beta[self.at[t]], self.std(t)))
                           for t in self.terms))

    def from_prior(self) -> FloatArray:
        """Return the distance (K,) of the coefficients from their prior means, in its std."""
        p, prior = self.design.n_shared, self.design.prior
        return np.concatenate([prior.whitened(self.beta[:p] - prior.mean),
                               self.beta[p:] / total_std(self.terms)])

    def std(self, term: Term) -> FloatArray:
        """Return the posterior standard deviations (K,) of the coefficients of a term."""
        here = self.at[term]
        return np.asarray(np.sqrt(np.maximum(self.covariance[here, here], 0.0)))

    def without(self, terms: tuple[Term, ...]) -> Posterior:
        """
        Return the posterior with the coefficients of some terms conditioned to 0.

        It keeps their places, with a covariance of 0.
        """
        here = np.concatenate([np.zeros(0, dtype=np.int64), *(self.at[t] for t in terms)])
        if not len(here):
            return self
        gain = self.covariance[:, here] @ np.linalg.inv(self.covariance[np.ix_(here, here)])
        beta = self.beta - gain @ self.beta[here]
        covariance = self.covariance - gain @ self.covariance[here]
        beta[here], covariance[here], covariance[:, here] = 0.0, 0.0, 0.0
        return Posterior(self.design, self.terms, self.precision, beta, covariance,
                         None if self.conditioned else (self, here),
                         (*self.absent, *terms), self._places)


def solve(design: Design, terms: tuple[Term, ...], precision: FloatArray) -> Posterior:
    """
    Return the posterior of the coefficients.

    :param precision: (N,) weight of a squared residual of each joint.
    """
    design.add(terms)
    p, prior = design.n_shared, design.prior
    a = block_diag(prior.precision, np.diag(total_std(terms) ** -2.0))
    b = np.zeros(len(a))
    b[:p] = prior.precision @ prior.mean
    draft = Posterior(design, terms, precision, b, a)
    for j in range(design.n_joints):
        cols, places = draft.columns(j), draft.places(j)
        b[places] += precision[j] * design.cross[j][cols]
        a[:p, :p] += precision[j] * design.gram[j][:p, :p]
        own = places[p:]
        products = precision[j] * design.gram[j][cols[p:]]
        a[own, :p] += products[:, :p]
        a[:p, own] += products[:, :p].T
        a[np.ix_(own, own)] += products[:, cols[p:]]
    size = 1.0 / np.sqrt(np.diag(a))
    scale = np.outer(size, size)
    factor = cho_factor(a * scale + 1e-13 * np.eye(len(a)), lower=True)
    # LAPACK refuses a matrix without rows, which an arm without gravity or friction has.
    lower = np.tril(dpotri(factor[0], lower=True)[0]) if len(a) else a
    covariance = (lower + np.tril(lower, -1).T) * scale
    return Posterior(design, terms, precision, size * cho_solve(factor, size * b), covariance,
                     _places=draft._places)


def leave_out(posterior: Posterior, rows: BoolArray, precision: FloatArray | None = None,
              n_angles: int = 0) -> Posterior:
    """
    Return the posterior of the other rows, linearised at the same point.

    It equals the posterior of a problem without these rows at the same noise.

    :param rows: mask (R,) of the rows to leave out.
    :param precision: weights (N,) of the joints, by default those of the posterior.
    :param n_angles: number of first parameters that keep their value.
    """
    design = posterior.design.without_rows(rows)
    fixed = design.with_narrow(n_angles) if n_angles else design
    other = solve(fixed, posterior.terms, posterior.precision if precision is None else precision)
    return replace(other, design=design)
