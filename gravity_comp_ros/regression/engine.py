"""The nonlinear loop: linearise, select terms, solve again, until the axes have converged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.noise import outlier_weights, robust_std
from gravity_comp_ros.regression.alternatives import (
    Alternative, alternatives, excluded_alternatives)
from gravity_comp_ros.regression.candidates import Candidates, candidates_of
from gravity_comp_ros.regression.design import Pool
from gravity_comp_ros.regression.exchanges import run
from gravity_comp_ros.regression.gains import gain, score_of, without_weak
from gravity_comp_ros.regression.linear import (
    gauss_newton, Linear, with_better_direction, with_exact_angles)
from gravity_comp_ros.regression.noise import (
    correlation_times, noise_std, precision_of, relative_weights, variance_by_motion)
from gravity_comp_ros.regression.posterior import leave_out, Posterior, solve
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.search import Search
from gravity_comp_ros.regression.shared import Shared
from gravity_comp_ros.regression.term import Key, Term
from gravity_comp_ros.regression.uncertainty import Uncertainty, uncertainty_of
import numpy as np


@dataclass(frozen=True, eq=False)
class Regression:
    """
    The result: the shared part at its estimate, and the posterior of all coefficients.

    `alternatives` are, by the key of a term, the terms that explain the data as well. `gains` are
    the gains of the terms in nats. `identified` is the share of each coefficient's torque (RMS)
    that all other columns leave, `unabsorbed` that of a term's whole torque that other terms
    leave. `motion` is that of the samples at the estimated gravity.
    """

    problem: Problem
    shared: Shared
    posterior: Posterior
    white_precision: FloatArray
    candidates: Candidates
    motion: Motion
    alternatives: Mapping[Key, tuple[Key, ...]]
    gains: Mapping[Key, float]
    uncertainty: Uncertainty
    identified: Mapping[Key, FloatArray]
    unabsorbed: Mapping[Key, float]
    steps: int
    converged: bool

    @property
    def terms(self) -> tuple[Term, ...]:
        return self.posterior.terms

    def without(self, rows: BoolArray) -> Posterior:
        """
        Return the posterior of the rows outside of a mask (R,), at the same angles.

        A linear step of an angle that few rows determine would be too long.
        """
        return leave_out(self.posterior, rows, self.white_precision, self.shared.n_angles)

    def evidence_at(self, precision: FloatArray) -> float:
        """Return the log evidence at weights (N,) of the joints, to compare two shared parts."""
        posterior = self.posterior
        return solve(posterior.design, posterior.terms, precision).log_evidence

    @property
    def noise(self) -> FloatArray:
        """Return each joint's standard deviation (N,) of the residual of a row, N·m."""
        return noise_std(self.posterior, self.problem.scale, self.problem.options)

    def is_white(self, limit: float) -> bool:
        """Return whether every joint's residual is close to the white noise of its torque."""
        return bool((self.noise <= limit * self.problem.white_noise).all())

    def held_out_ratio(self, sigma: FloatArray) -> float:
        """Return the RMS of the held-out residuals of all joints, in multiples of sigma (N,)."""
        squares, fold = np.zeros(len(sigma)), self.problem.rows.fold
        for k in np.unique(fold):
            without = self.without(fold == k)
            squares += [float((without.residual(j) ** 2).sum()) for j in range(len(sigma))]
        return float(np.sqrt((squares / len(fold) / sigma ** 2).mean()))

    def torque_at_rest(self) -> FloatArray:
        """
        Return the torque of the rows without dynamics and effects of motion, (R, N) in N·m.

        Static effects are included: those of a wrong gravity explain what it misses.
        """
        problem, posterior = self.problem, self.posterior
        gravity = self.shared.gravity(problem.samples.q)
        torque = problem.rows.mean(gravity) + posterior.unweighted_residual()
        for term in posterior.terms:
            if term.effect.is_static:
                for j in term.joints(posterior.design.n_joints):
                    torque[:, j] += term.on(j) @ posterior.beta[posterior.at[term]]
        return torque


def regress(problem: Problem, shared: Shared, effects: Sequence[Effect],
            start: Iterable[Term] = (), forced: frozenset[Key] = frozenset(),
            is_selected: bool = False,
            log: Callable[[str], None] = lambda text: None) -> Regression:
    """
    Return the regression of a problem.

    :param shared: the shared part at a start (`linear.with_common_terms`).
    :param effects: the effects to test.
    :param start: terms that are in the model at the beginning.
    :param forced: keys of terms that stay in the model.
    :param is_selected: whether the start was selected among all effects. Otherwise the axes are
        estimated before effects that resemble a wrong axis are selected.
    """
    options, shared, terms = problem.options, shared.renewed(), tuple(start)
    fit = Linear.at(problem, shared, problem.factory(shared), terms, problem.weights)
    if terms:
        # Outliers and relative noise are those of a fit with its own noise.
        search = _search(fit, (), frozenset(term.key for term in terms), log)
        run(search, with_exchanges=False)
        fit = gauss_newton(fit.selected(search.posterior))[0]
        fit = fit.weighted(_weights(fit))
    for number in range(int(is_selected), max(options.passes, 1 + is_selected)):
        tested = effects if number else [e for e in effects if not e.resembles_gravity]
        search = _search(fit, tested, forced, log)
        changed = run(search, with_exchanges=number > 0)
        fit, steps, converged = gauss_newton(fit.selected(search.posterior))
        log(f'pass {number}: {len(search.terms)} terms')
        turned = with_better_direction(fit)
        if number and not changed and turned is fit:
            break
        fit = turned.weighted(_weights(turned))
    exact = with_exact_angles(fit)
    if exact is not fit:
        fit, search = _without_turned_axes(exact, search, effects)
    fit, published = _without_weak(fit, search.forced)
    keys = {term.key for term in published.terms}
    search.select([term for term in search.terms if term.key in keys], published.precision)
    search.tabu.clear()
    ambiguous = {term.key: _ambiguous(search, term) for term in search.terms}
    scores = {term.key: score_of(published.without((term,)), term) for term in published.terms}
    gains = {term.key: gain(published.without((term,)), scores[term.key])
             for term in published.terms}
    uncertainty = uncertainty_of(search, published, ambiguous)
    unabsorbed = {term.key: scores[term.key].share_left(published.beta[at])
                  for term, at in published.at.items()}
    published = replace(published, beta=fit.at_point().beta)
    return Regression(problem, fit.shared, published, fit.posterior.precision, search.candidates,
                      fit.factory.motion,
                      {key: tuple(dict.fromkeys(other.term.key for other in others))
                       for key, others in ambiguous.items()}, gains, uncertainty,
                      {key: s.identified for key, s in scores.items()}, unabsorbed, steps,
                      converged)


def _published(fit: Linear) -> Posterior:
    """
    Return the posterior at the noise of the residual, whose rows are autocorrelated.

    Exact angles may be free ones with the probability of their evidence.
    """
    scale, options = fit.problem.scale, fit.problem.options
    design = fit.posterior.design.with_wider(fit.shared.exact_std())
    posterior = solve(design, fit.posterior.terms, precision_of(fit.posterior, scale, options))
    return solve(posterior.design, posterior.terms, precision_of(
        posterior, scale, options, correlation_times(posterior)))


def _without_weak(fit: Linear, forced: frozenset[Key]) -> tuple[Linear, Posterior]:
    """
    Return the fit without terms that its published noise does not confirm, and its `_published`.

    The search has the noise of single rows. An offset and a tilt of the base that are determined
    by their difference alone may otherwise remain, large and with opposite signs.
    """
    published = _published(fit)
    posterior = without_weak(published, lambda term: term.key not in forced,
                             fit.problem.options.min_gain)
    if posterior is published:
        return fit, published
    fit = gauss_newton(fit.selected(posterior))[0]
    return fit, _published(fit)


def _without_turned_axes(fit: Linear, search: Search, effects: Sequence[Effect]
                         ) -> tuple[Linear, Search]:
    """
    Return fit and search with terms selected at exact angles, also those that are only near.

    The axes are estimated before static effects are selected, so that a small tilt of an axis may
    explain an offset or a spring. They are returned where they are not ambiguous with the fit:
    the uncertainty of a free angle contains both.
    """
    problem = fit.problem
    near = fit.shared.at_near_angles()
    other = fit if near is fit.shared else gauss_newton(fit.on(near.renewed()))[0]
    again = _search(other, effects, search.forced, search.log)
    run(again)
    other = gauss_newton(other.selected(again.posterior))[0]
    precision = precision_of(fit.posterior, problem.scale, problem.options)
    evidences = [solve(each.posterior.design, each.posterior.terms, precision).log_evidence
                 for each in (fit, other)]
    search.log(f'exact angles: {evidences[1] - evidences[0]:.1f} nats')
    return (other, again) if evidences[1] > evidences[0] + problem.options.margin else (
        fit, search)


def _search(fit: Linear, effects: Sequence[Effect], forced: frozenset[Key],
            log: Callable[[str], None]) -> Search:
    """Return a search at the present estimate of the shared part."""
    problem, design = fit.problem, fit.posterior.design
    candidates = candidates_of(fit.factory, effects)
    pools = (*(Pool(design, [j], terms) for j, terms in enumerate(candidates.of_joint)),
             Pool(design, range(design.n_joints), candidates.of_arm))
    posterior = solve(design, fit.posterior.terms, precision_of(
        fit.posterior, problem.scale, problem.options))
    return Search(design, candidates, pools, fit.factory, problem.scale, problem.white_noise,
                  problem.options, posterior, forced, log)


def _weights(fit: Linear) -> FloatArray:
    """Return the weights (R, N) of the rows: relative noise, outliers, and their duration."""
    problem, residual = fit.problem, fit.posterior.unweighted_residual()
    gravity = problem.rows.mean(fit.factory.motion.gravity)
    relative = relative_weights(residual, gravity) / (
        1.0 + variance_by_motion(fit.posterior, fit.factory) / robust_std(residual) ** 2)
    return np.asarray(problem.rows.weights[:, None] * relative * outlier_weights(
        np.sqrt(relative) * residual))


def _ambiguous(search: Search, term: Term) -> list[Alternative]:
    """
    Return the terms that could replace one within the margin.

    They include effects of its joint that this motion does not make testable. Their sizes are not
    tested either, so that the priors of these do not exclude one that fits as well.
    """
    chosen, margin = search.posterior, search.options.margin
    untested = excluded_alternatives(search, term)
    return [*(other for other in alternatives(search, term)
              if other.log_evidence > chosen.log_evidence - margin),
            *(other for other in untested
              if other.posterior.likelihood_and_odds > chosen.likelihood_and_odds - margin)]
