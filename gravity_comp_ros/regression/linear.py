"""
Gauss-Newton on the posterior: linearise at the shared part, solve, and move.

Angles have a prior about their present estimate. While a step does not lower the objective, that
prior is made narrower and the step is solved again (K. Levenberg, A method for the solution of
certain non-linear problems in least squares, 1944). The objective is the sum of squared residuals
over the noise and squared coefficients over their prior, minimal over all coefficients but the
angles (G. Golub, V. Pereyra, SIAM Journal on Numerical Analysis 10, 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.regression.candidates import common_terms, TermFactory
from gravity_comp_ros.regression.design import Design, FIXED
from gravity_comp_ros.regression.noise import (
    CONVERGED, MAX_NOISES, precision_of, white_precision)
from gravity_comp_ros.regression.posterior import Posterior, solve
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.shared import Shared
from gravity_comp_ros.regression.term import Term
import numpy as np

# Factor of the prior of the angles after a step that fails, and the smallest one that is tried.
_NARROWER, _NARROWEST = 0.25, 1e-3
# Share of the decrease at which it has converged, below which the next step is not made: a tenth
# of a standard deviation.
_NEGLIGIBLE = 0.01


@dataclass(frozen=True, eq=False)
class Linear:
    """The problem linearised at a shared part, and the posterior of some terms there."""

    problem: Problem
    shared: Shared
    factory: TermFactory
    weights: FloatArray
    posterior: Posterior

    @classmethod
    def at(cls, problem: Problem, shared: Shared, factory: TermFactory, terms: tuple[Term, ...],
           weights: FloatArray, precision: FloatArray | None = None, is_known: bool = True
           ) -> Linear:
        """
        Return the solution.

        :param precision: weights (N,) of the joints' noise, or with `is_known` false a start of
            them; those of the residual without it.
        """
        design = _design(problem, shared, weights)
        if precision is None or not is_known:
            precision = _precision(problem, design, terms, shared.n_angles, precision)
        return cls(problem, shared, factory, weights, solve(design, terms, precision))

    def moved(self, narrowed: float, renewed: bool = False) -> Linear:
        """
        Return the problem linearised at the present estimate, with the same terms.

        :param narrowed: factor of the prior of the angles.
        :param renewed: whether the noise is estimated again.
        """
        beta = self.with_narrow_angles(narrowed).beta
        return self.on(self.shared.moved(beta[:len(self.shared.point)]),
                       self.posterior.precision, is_known=not renewed).centred()

    def on(self, shared: Shared, precision: FloatArray | None = None, is_known: bool = True
           ) -> Linear:
        """Return the problem linearised at another shared part, with the same terms."""
        factory = self.problem.factory(shared)
        return Linear.at(self.problem, shared, factory, tuple(
            map(factory.again, self.posterior.terms)), self.weights, precision, is_known)

    def centred(self) -> Linear:
        """
        Return the problem linearised at the best linear parameters for the angles of the point.

        The columns of the angles are proportional to the moments.
        """
        if not self.shared.n_angles:
            return self
        return self.on(self.shared.moved(self.with_narrow_angles(FIXED).beta[
            :len(self.shared.point)]), self.posterior.precision)

    def with_narrow_angles(self, factor: float) -> Posterior:
        """Return the posterior with the prior of the angles narrowed by a factor."""
        if factor == 1.0 or not self.shared.n_angles:
            return self.posterior
        design = self.posterior.design.with_narrow(self.shared.n_angles, factor)
        return solve(design, self.posterior.terms, self.posterior.precision)

    def at_point(self) -> Posterior:
        """Return the posterior with the mean at the angles of the point, to which models refer."""
        return replace(self.posterior, beta=self.with_narrow_angles(FIXED).beta)

    def objective(self, precision: FloatArray) -> float:
        """Return the objective at the angles of the point, minimal over all other coefficients."""
        posterior = self.posterior
        design = posterior.design.with_narrow(self.shared.n_angles)
        return _objective(solve(design, posterior.terms, precision))

    def selected(self, posterior: Posterior) -> Linear:
        """Return the solution with the terms of a posterior on the same columns."""
        problem = self.problem
        return replace(self, posterior=solve(posterior.design, posterior.terms, white_precision(
            posterior, problem.scale, problem.options)))

    def weighted(self, weights: FloatArray) -> Linear:
        """Return the same with a renewed shared part and other weights (R, N) of the rows."""
        return Linear.at(self.problem, self.shared.renewed(), self.factory, self.posterior.terms,
                         weights, self.posterior.precision)


def gauss_newton(fit: Linear, renewed: bool = False) -> tuple[Linear, int, bool]:
    """
    Return the fit after a few steps with the same terms, their number, and if they converged.

    It is linearised at its own estimate (`centred`).

    :param renewed: whether the noise is estimated again in each step.
    """
    options, narrowed = fit.problem.options, 1.0
    # Otherwise columns of terms change with gravity in a step, and the objective a little by that.
    is_linear = not any(term.effect.uses_gravity for term in fit.posterior.terms)
    for step in range(options.steps):
        if not fit.shared.n_angles:
            return fit.moved(narrowed, renewed), step + 1, True
        precision = fit.posterior.precision
        before = fit.objective(precision)
        enough = options.converged * before / fit.problem.y.size
        if is_linear and before - _objective(fit.posterior) < _NEGLIGIBLE * enough:
            return fit if step else fit.centred(), step, True
        following = fit.moved(narrowed, renewed)
        after, allowed = following.objective(precision), before + (0.0 if is_linear else enough)
        while after > allowed and narrowed > _NARROWEST:
            narrowed *= _NARROWER
            following = fit.moved(narrowed, renewed)
            after = following.objective(precision)
        if before - after < enough:
            if after < allowed:
                return following, step + 1, True
            return fit if step else fit.centred(), step + 1, True
        fit, narrowed = following, min(1.0, narrowed / _NARROWER)
    return fit, options.steps, False


def _objective(posterior: Posterior) -> float:
    """Return the objective of a linearised problem at the posterior's mean."""
    return float(posterior.precision @ posterior.squares + (posterior.from_prior() ** 2).sum())


def with_better_direction(fit: Linear) -> Linear:
    """
    Return the fit with the first joint reversed where that is more probable.

    Gravity does not depend on the direction of a vertical first axis, the torque of motion does.
    """
    shared, precision = fit.shared.with_first_reversed(), fit.posterior.precision
    if shared is fit.shared:
        return fit
    other = fit.on(shared, precision)
    gain = 0.5 * (fit.objective(precision) - other.objective(precision))
    if gain < fit.problem.options.margin:
        return fit
    return gauss_newton(other.centred(), renewed=True)[0]


def with_exact_angles(fit: Linear) -> Linear:
    """
    Return the fit with exact angles where that is more probable.

    Each exact angle determines others better, so that more of them may be exact.
    """
    p = len(fit.shared.point)
    while True:
        posterior = solve(fit.posterior.design, fit.posterior.terms, precision_of(
            fit.posterior, fit.problem.scale, fit.problem.options))
        shared = fit.shared.with_exact_angles(posterior.covariance[:p, :p])
        if shared is fit.shared:
            return fit
        fit = gauss_newton(fit.on(shared.renewed(), fit.posterior.precision))[0]


def with_common_terms(problem: Problem, shared: Shared, effects: Sequence[Effect]) -> Linear:
    """Return the shared part as estimated together with the effects common in joints."""
    factory = problem.factory(shared)
    fit = Linear.at(problem, shared, factory, common_terms(factory, effects), problem.weights)
    # Without moments and lengths the torque does not depend on the angles.
    return gauss_newton(fit.on(fit.centred().shared.renewed(), fit.posterior.precision,
                               is_known=False), renewed=True)[0]


def _precision(problem: Problem, design: Design, terms: tuple[Term, ...], n_angles: int,
               precision: FloatArray | None) -> FloatArray:
    """
    Return the weights (N,) of the noise of the residual at the angles of the point.

    A step of the angles that is too long has a small linearised residual. The priors dominate the
    first solution, whose noise is that of the whole torque.

    :param precision: a start (N,) of the weights.
    """
    design = design.with_narrow(n_angles)
    if precision is None:
        precision = np.asarray(1.0 / (np.var(problem.y, axis=0)
                                      + (1e-3 * problem.scale.torque) ** 2))
    for _ in range(MAX_NOISES):
        ratio, precision = precision, white_precision(
            solve(design, terms, precision), problem.scale, problem.options)
        if np.abs(np.log(ratio / precision)).max() < CONVERGED:
            break
    return precision


def _design(problem: Problem, shared: Shared, weights: FloatArray) -> Design:
    """
    Return the linearised problem.

    Its target is the measured torque: the torque is linear in all parameters but the angles, which
    are 0 at the point.
    """
    return Design(problem.rows, problem.y, problem.states.mean(shared.columns),
                  shared.prior(problem.scale), weights, problem.options.law_error)
