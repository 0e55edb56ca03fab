"""The nonlinear loop: linearise, select terms, solve again, until the axes have converged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.regression.candidates import Candidates, candidates_of, TermFactory
from gravity_comp_ros.regression.design import Design, Pool
from gravity_comp_ros.regression.gains import gain, score_of
from gravity_comp_ros.regression.noise import correlation_times, noise_std, precision_of
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.posterior import Posterior, solve
from gravity_comp_ros.regression.rows import Rows, rows_of
from gravity_comp_ros.regression.scale import Scale
from gravity_comp_ros.regression.search import Search
from gravity_comp_ros.regression.shared import Shared, State
from gravity_comp_ros.regression.term import Key, Term
from gravity_comp_ros.effects.effect import Effect
from gravity_comp_ros.effects.motion import Motion
import numpy as np

_MAD = 1.4826
# Largest relative step of the shared parameters at which the axes have converged.
_CONVERGED = 1e-4


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples with their motion, rows and scales; the same for every linearisation."""

    samples: JointSamples
    motion: Motion
    rows: Rows
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
        return cls(samples, motion, rows, Scale.of(samples, options), rows.mean(samples.tau),
                   options)

    def state(self, numbers: IntArray) -> State:
        """Return the state at sample numbers."""
        return State(self.samples.q[numbers], self.samples.qd[numbers], self.motion.qdd[numbers])


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
    terms, options = tuple(start), problem.options
    precision: FloatArray | None = None
    weights = np.repeat(problem.rows.weights[:, None], problem.y.shape[1], axis=1)
    for number in range(options.passes):
        search = _linearised(problem, shared, effects, terms, precision, weights, forced, log)
        if number == 0 and not search.terms:
            shared = shared.moved(search.posterior.beta[:len(shared.point)])
            search = _linearised(problem, shared, effects, terms, None, weights, forced, log)
        before = {(t.key, tuple(t.setting.items())) for t in search.terms}
        posterior = search.run()
        terms, precision = posterior.terms, posterior.precision
        shared, posterior, steps, converged = _gauss_newton(
            problem, shared, search.factory, posterior, weights)
        log(f'pass {number}: {len(terms)} terms')
        weights = problem.rows.weights[:, None] * huber_weights(_residual(posterior), options)
        if number and before == {(t.key, tuple(t.setting.items())) for t in terms}:
            break
    search = _linearised(problem, shared, effects, terms, precision, weights, forced, log)
    alternatives = {term.key: _ambiguous(search, term) for term in search.terms}
    scores = {term.key: score_of(search.posterior.without((term,)), term)
              for term in search.terms}
    gains = {term.key: gain(search.posterior.without((term,)), scores[term.key])
             for term in search.terms}
    published = solve(search.design, search.terms, precision_of(
        search.posterior, problem.scale, options, correlation_times(search.posterior)))
    return Regression(problem, shared, published, search.candidates, search.factory.motion,
                      alternatives, gains, {key: s.unabsorbed for key, s in scores.items()}, steps,
                      converged)


def _linearised(problem: Problem, shared: Shared, effects: Sequence[Effect],
                terms: tuple[Term, ...], precision: FloatArray | None, weights: FloatArray,
                forced: frozenset[Key], log: Callable[[str], None]) -> Search:
    """Return a search at the present estimate of the shared part."""
    gravity = shared.gravity(problem.samples.q)
    motion = problem.motion.with_gravity(gravity, shared.gradient,
                                         getattr(shared, 'chain', None),
                                         getattr(shared, 'geometry', None))
    factory = TermFactory(motion, problem.rows, problem.scale, problem.terms)
    design = _design(problem, shared, weights)
    candidates = candidates_of(factory, effects)
    pools = (*(Pool(design, [j], terms) for j, terms in enumerate(candidates.of_joint)),
             Pool(design, range(design.n_joints), candidates.of_arm))
    selected = tuple(factory.again(term) for term in terms)
    if precision is None:
        precision = _first_precision(problem)
        posterior = solve(design, selected, precision)
        posterior = solve(design, selected,
                          precision_of(posterior, problem.scale, problem.options))
    else:
        posterior = solve(design, selected, precision)
    return Search(design, candidates, pools, factory, problem.scale, problem.options, posterior,
                  forced, log)


def _first_precision(problem: Problem) -> FloatArray:
    return np.asarray(1.0 / (np.var(problem.y, axis=0) + (1e-3 * problem.scale.torque) ** 2))


def _design(problem: Problem, shared: Shared, weights: FloatArray) -> Design:
    """Return the linearised problem: the target is the torque that the columns explain."""
    rows = problem.rows
    columns = rows.mean_of(lambda numbers: shared.columns(problem.state(numbers)))
    y = problem.y
    if not shared.is_linear:
        y = y - rows.mean_of(lambda numbers: shared.constant(problem.state(numbers)))
    return Design(rows, y, columns, shared.prior_std(problem.scale), weights)


def _gauss_newton(problem: Problem, shared: Shared, factory: TermFactory, posterior: Posterior,
                  weights: FloatArray) -> tuple[Shared, Posterior, int, bool]:
    """Return the shared part after a few steps with the same terms, and the last posterior."""
    p = len(shared.point)
    scale = shared.prior_std(problem.scale)
    size = np.inf
    for step in range(1, problem.options.steps + 1):
        change = (posterior.beta[:p] - shared.point) / scale
        shared = shared.moved(posterior.beta[:p])
        size = float(np.abs(change).max())
        if shared.is_linear or size < _CONVERGED:
            return shared, posterior, step, True
        gravity = shared.gravity(problem.samples.q)
        motion = factory.motion.with_gravity(gravity, shared.gradient,
                                             getattr(shared, 'chain', None),
                                             getattr(shared, 'geometry', None))
        factory = TermFactory(motion, problem.rows, problem.scale, problem.terms)
        terms = tuple(factory.again(term) for term in posterior.terms)
        posterior = solve(_design(problem, shared, weights), terms, posterior.precision)
    shared = shared.moved(posterior.beta[:p])
    return shared, posterior, problem.options.steps, size < 10 * _CONVERGED


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
