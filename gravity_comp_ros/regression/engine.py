"""The nonlinear loop: linearise, select terms, solve again, until the axes have converged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.regression.candidates import (
    Candidates, candidates_of, common_terms, TermFactory)
from gravity_comp_ros.regression.design import Design, Pool
from gravity_comp_ros.regression.gains import gain, score_of
from gravity_comp_ros.regression.noise import correlation_times, noise_std, precision_of
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.posterior import Posterior, solve
from gravity_comp_ros.regression.rows import Rows, rows_of
from gravity_comp_ros.regression.scale import Scale
from gravity_comp_ros.regression.search import Search
from gravity_comp_ros.regression.shared import Shared
from gravity_comp_ros.regression.states import States, states_of
from gravity_comp_ros.regression.term import Key, Term
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.motion import Motion
import numpy as np

_MAD = 1.4826


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples with their motion, rows and scales; the same for every linearisation."""

    samples: JointSamples
    motion: Motion
    rows: Rows
    states: States
    scale: Scale
    y: FloatArray
    options: EngineOptions
    terms: dict[object, Term] = field(default_factory=dict)  # those that do not depend on gravity

    @classmethod
    def of(cls, samples: JointSamples, use: BoolArray | None = None,
           options: EngineOptions = EngineOptions()) -> Problem:
        """
        Return the problem of samples.

        :param use: mask (M,) of the samples to fit; None for all.
        :raises FitError: if there are none.
        """
        rows = rows_of(samples, options, use)
        motion = Motion.of(samples, np.zeros_like(samples.q), _no_gradient)
        states = states_of(rows, samples.q, samples.qd, motion.qdd, options.cell_angle)
        return cls(samples, motion, rows, states, Scale.of(samples, options),
                   rows.mean(samples.tau), options)

    def factory(self, shared: Shared) -> TermFactory:
        """Return the factory of terms on this motion with the gravity of a shared part."""
        motion = self.motion.with_gravity(shared.gravity(self.samples.q), shared.gradient,
                                          getattr(shared, 'chain', None),
                                          getattr(shared, 'geometry', None))
        return TermFactory(motion, self.rows, self.scale, self.terms)


@dataclass(frozen=True, eq=False)
class Regression:
    """
    The result: the shared part at its estimate, and the posterior of all coefficients.

    `alternatives` are, by the key of a term, the terms that explain the data as well. `gains` are
    the gains of the terms in nats, `unabsorbed` the shares of their squared torque that gravity
    and the other terms leave. `motion` is that of the samples at the estimated gravity.
    """

    problem: Problem
    shared: Shared
    posterior: Posterior
    candidates: Candidates
    motion: Motion
    alternatives: Mapping[Key, tuple[Key, ...]]
    gains: Mapping[Key, float]
    unabsorbed: Mapping[Key, float]
    steps: int
    converged: bool

    @property
    def terms(self) -> tuple[Term, ...]:
        return self.posterior.terms

    @property
    def noise(self) -> FloatArray:
        """Return each joint's standard deviation (N,) of the residual of a row, N·m."""
        return noise_std(self.posterior, self.problem.scale, self.problem.options)


def regress(problem: Problem, shared: Shared, effects: Sequence[Effect],
            start: Iterable[Term] = (), forced: frozenset[Key] = frozenset(),
            log: Callable[[str], None] = lambda text: None) -> Regression:
    """
    Return the regression of a problem.

    :param shared: the shared part at a start.
    :param effects: the effects to test.
    :param start: terms that are in the model at the beginning.
    :param forced: keys of terms that stay in the model.
    """
    options = problem.options
    weights = np.repeat(problem.rows.weights[:, None], problem.y.shape[1], axis=1)
    terms = tuple(start)
    if not terms:
        shared = _with_common_terms(problem, shared, effects, weights)
    fit = _Linear.at(problem, shared, problem.factory(shared), terms, weights)
    for number in range(options.passes):
        search = _search(fit, effects, forced, log)
        changed = search.run(with_exchanges=number > 0)
        fit, steps, converged = _gauss_newton(fit.selected(search.posterior))
        log(f'pass {number}: {len(search.terms)} terms')
        if number and not changed:
            break
        fit = fit.weighted(
            problem.rows.weights[:, None] * huber_weights(_residual(fit.posterior), options))
    alternatives = {term.key: _ambiguous(search, term) for term in search.terms}
    posterior = fit.posterior
    scores = {term.key: score_of(posterior.without((term,)), term) for term in posterior.terms}
    gains = {term.key: gain(posterior.without((term,)), scores[term.key])
             for term in posterior.terms}
    published = solve(posterior.design, posterior.terms, precision_of(
        posterior, problem.scale, options, correlation_times(posterior)))
    return Regression(problem, fit.shared, published, search.candidates, fit.factory.motion,
                      alternatives, gains, {key: s.unabsorbed for key, s in scores.items()}, steps,
                      converged)


@dataclass(frozen=True, eq=False)
class _Linear:
    """The problem linearised at a shared part, and the posterior of some terms there."""

    problem: Problem
    shared: Shared
    factory: TermFactory
    weights: FloatArray
    posterior: Posterior

    @classmethod
    def at(cls, problem: Problem, shared: Shared, factory: TermFactory, terms: tuple[Term, ...],
           weights: FloatArray, precision: FloatArray | None = None) -> _Linear:
        """Return the solution; without a precision the noise is that of its residual."""
        design = _design(problem, shared, weights)
        posterior = solve(design, terms,
                          _first_precision(problem) if precision is None else precision)
        if precision is None:
            posterior = solve(design, terms,
                              precision_of(posterior, problem.scale, problem.options))
        return cls(problem, shared, factory, weights, posterior)

    def stepped(self, renewed: bool = False) -> _Linear:
        """
        Return the problem linearised at the present estimate, with the same terms.

        :param renewed: whether the noise is estimated again.
        """
        shared = self.shared.moved(self.posterior.beta[:len(self.shared.point)])
        factory = self.problem.factory(shared)
        terms = tuple(factory.again(term) for term in self.posterior.terms)
        return _Linear.at(self.problem, shared, factory, terms, self.weights,
                          None if renewed else self.posterior.precision)

    def selected(self, posterior: Posterior) -> _Linear:
        """Return the same with another posterior."""
        return replace(self, posterior=posterior)

    def weighted(self, weights: FloatArray) -> _Linear:
        """Return the same with other weights (R, N) of the rows."""
        return _Linear.at(self.problem, self.shared, self.factory, self.posterior.terms, weights,
                          self.posterior.precision)


def _with_common_terms(problem: Problem, shared: Shared, effects: Sequence[Effect],
                       weights: FloatArray) -> Shared:
    """Return the shared part that is estimated together with the effects common in joints."""
    factory = problem.factory(shared)
    terms = common_terms(factory, effects)
    return _gauss_newton(_Linear.at(problem, shared, factory, terms, weights), renewed=True)[0].shared


def _search(fit: _Linear, effects: Sequence[Effect], forced: frozenset[Key],
            log: Callable[[str], None]) -> Search:
    """Return a search at the present estimate of the shared part."""
    problem, design = fit.problem, fit.posterior.design
    candidates = candidates_of(fit.factory, effects)
    pools = (*(Pool(design, [j], terms) for j, terms in enumerate(candidates.of_joint)),
             Pool(design, range(design.n_joints), candidates.of_arm))
    return Search(design, candidates, pools, fit.factory, problem.scale, problem.options,
                  fit.posterior, forced, log)


def _gauss_newton(fit: _Linear, renewed: bool = False) -> tuple[_Linear, int, bool]:
    """Return the fit after a few steps with the same terms, their number, and if they converged."""
    options = fit.problem.options
    for step in range(options.steps):
        p = len(fit.shared.point)
        change = np.abs(fit.posterior.beta[:p] - fit.shared.point)
        std = np.sqrt(np.maximum(np.diag(fit.posterior.covariance)[:p], 1e-300))
        if float((change / std).max(initial=0.0)) <= options.converged:
            return fit, step, True
        fit = fit.stepped(renewed)
        if fit.shared.is_linear:
            return fit, step + 1, True
    return fit, options.steps, False


def _first_precision(problem: Problem) -> FloatArray:
    return np.asarray(1.0 / (np.var(problem.y, axis=0) + (1e-3 * problem.scale.torque) ** 2))


def _design(problem: Problem, shared: Shared, weights: FloatArray) -> Design:
    """Return the linearised problem: the target is the torque that the columns explain."""
    rows = problem.rows
    columns, y = problem.states.mean(shared.columns), problem.y
    if not shared.is_linear:
        y = y - problem.states.mean(shared.constant)
    return Design(rows, y, columns, shared.prior_std(problem.scale), weights)


def _residual(posterior: Posterior) -> FloatArray:
    """Return the unweighted residual of all joints, (R, N) in N·m."""
    parts = [posterior.residual(j) for j in range(posterior.design.n_joints)]
    return np.stack(parts, axis=1) / np.maximum(posterior.design.root.T, 1e-9)


def huber_weights(residual: FloatArray, options: EngineOptions) -> FloatArray:
    """Return the weight (R, N) of each residual: 1, less for outliers."""
    sigma = _MAD * np.median(np.abs(residual), axis=0)
    limit = options.outlier * np.maximum(sigma, 1e-12)
    return np.asarray(np.minimum(1.0, limit / np.maximum(np.abs(residual), 1e-12)))


def _ambiguous(search: Search, term: Term) -> tuple[Key, ...]:
    """Return the keys of the terms that could replace one within the margin."""
    lowest = search.posterior.log_evidence - search.options.margin
    return tuple(other.key for evidence, other in search.alternatives(term) if evidence > lowest)


def _no_gradient(q: FloatArray) -> FloatArray:
    raise NotImplementedError('the gravity of this motion is not known yet')
