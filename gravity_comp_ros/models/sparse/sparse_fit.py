"""
Sparse fits: of one potential energy for all joints, or of one sum for each joint's torque.

Potential: U = sum_k theta_k phi_k(q), tau_n = dU/dq_n. All joints share theta, so the data of each
joint determine the others as well. Non-conservative torques (friction) and offsets cannot be
represented and remain in the residual.

Per joint: tau_n = F beta_n over all 3^N features (Yu 2022, Eqs. 5-9). It is accurate within the
trained range. Outside, the joints' torques are not coupled, and the error can exceed the torque
itself.

The variance inflation factor is selected on held-out data. A white residual requires no inflation.
An autocorrelated residual (friction, hysteresis, drift) is overfitted by the growing support, with
large errors on the next run. So factors up to twice the residual's correlation time are tried on
held-out runs, or on blocks of ten seconds if there are too few runs. The largest factor whose
error is within one standard error of the lowest is selected, which yields the smallest support of
that accuracy. It multiplies the variance, and with it lambda and every price.

The steps of a fit are iterated. The noise determines the row weights and lambda. ADMM solves the
L1 problem (Yu 2022, Eqs. 8-14), which proposes features. The support is selected by description
length and refitted without the penalty, which removes the shrinkage. The residual yields the next
noise estimate. The initial noise is the torque itself and falls from round to round, so each round
explains the coarser part of the residual, and noise is not fitted as signal.

The support is grown without the inflation and pruned with it. Features that could replace one of
its own at nearly the same score are added to it in the end: the regression that estimates the
weights of all of them (`regression.dictionary_columns`) averages over them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.sparse import support
from gravity_comp_ros.models.sparse.dictionary import (
    Expansion, usable_for_energy, usable_for_torque)
from gravity_comp_ros.models.sparse.lasso import LassoProblem, LassoSolution
from gravity_comp_ros.models.sparse.regressor import Design, EnergyDesign, TorqueDesign
import numpy as np

# Variance inflation factors that are tried.
_FACTORS = (1.0, 3.0, 10.0, 30.0, 100.0)
# Maximum number of rounds, and relative change of the noise at which they end.
_ROUNDS, _CONVERGED = 20, 0.05


def fit_potential(samples: JointSamples, fold: IntArray
                  ) -> tuple[Expansion, list[SparseFit]]:
    """
    Fit one sparse potential energy to the torques of all joints.

    :param fold: numbers (M,) of the samples that are held out together.
    :return: the energy in J, and its sparse fit.
    :raises FitError: if there are no samples.
    """
    problem = SparseProblem(EnergyDesign, samples.q, samples.tau,
                            samples.runs, fold, usable_for_energy(samples.q))
    fit = fit_sparse(problem)
    return Expansion(fit.indices, fit.x), [fit]


def fit_per_joint(samples: JointSamples, fold: IntArray
                  ) -> tuple[tuple[Expansion, ...], list[SparseFit]]:
    """
    Fit each joint's torque separately.

    :param fold: numbers (M,) of the samples that are held out together.
    :return: one expansion per joint in N·m, and their sparse fits.
    :raises FitError: if there are no samples.
    """
    usable = usable_for_torque(samples.q)
    fits = [fit_sparse(SparseProblem(TorqueDesign, samples.q, samples.tau[:, [joint]],
                                     samples.runs, fold, usable))
            for joint in range(samples.n_joints)]
    return tuple(Expansion(fit.indices, fit.x) for fit in fits), fits


def fit_sparse(problem: SparseProblem) -> SparseFit:
    """
    Return the sparse fit of `problem`.

    :raises FitError: if there are no samples.
    """
    grown = grow(problem)
    inflation = choose_inflation(problem, grown)
    return finish(problem, prune(problem, grown, inflation), inflation)


def choose_inflation(problem: SparseProblem, grown: SupportFit) -> float:
    """Return the variance inflation factor for a grown support."""
    times = noise.correlation_times(grown.residual, problem.runs)
    time = float(np.median(times))
    tried = [k for k in _FACTORS if k == 1.0 or k < 2.0 * time]
    if time < noise.WHITE or len(tried) < 2:
        return 1.0
    scale = np.sqrt((grown.residual ** 2).mean(axis=0)) + noise.floor(problem.tau)
    errors = np.array([_held_out(problem, problem.fold == k, tried, scale)
                       for k in np.unique(problem.fold)])
    best = int(np.argmin(errors.mean(axis=0)))
    excess = errors - errors[:, [best]]
    allowed = excess.mean(axis=0) <= excess.std(axis=0, ddof=1) / np.sqrt(len(errors))
    return max(k for k, is_allowed in zip(tried, allowed) if is_allowed or k == tried[best])


def _held_out(problem: SparseProblem, test: BoolArray, tried: list[float],
              scale: FloatArray) -> FloatArray:
    """Return the mean square error on the held-out mask `test`, for each factor."""
    train, held_out = problem.select(~test), problem.select(test)
    fit = grow(train)
    errors = []
    for inflation in tried:
        fit = prune(train, fit, inflation)
        predicted = held_out.predict(fit.refit.indices, fit.refit.x)
        errors.append(float((((held_out.tau - predicted) / scale) ** 2).mean()))
    return np.array(errors)


DesignType = Callable[[FloatArray, FloatArray], Design]


@dataclass(frozen=True, eq=False)
class SparseProblem:
    """
    Torques `tau` (M, J) of poses `q` (M, N), with the type of design to explain them.

    J is 1 for the features of one joint and N for those of one energy. `usable` masks the 3^N
    features that may be selected; `runs` (M,) numbers the run of each sample, `fold` (M,) those
    that are held out together.
    """

    design_type: DesignType
    q: FloatArray
    tau: FloatArray
    runs: IntArray
    fold: IntArray
    usable: BoolArray

    @property
    def n_joints(self) -> int:
        return self.q.shape[1]

    @cached_property
    def unweighted(self) -> Design:
        """The design without weights, with all quantities that depend on the poses only."""
        return self.design_type(self.q, np.ones(self.tau.shape))

    def weighted(self, sigma: FloatArray, inflation: float) -> tuple[Design, FloatArray]:
        """Return the design and the right-hand side in units of the noise sigma (J,) in N·m."""
        weights = np.broadcast_to(1.0 / (sigma * np.sqrt(inflation)), self.tau.shape)
        return self.unweighted.reweighted(weights), (weights * self.tau).T.ravel()

    def predict(self, indices: IntArray, x: FloatArray) -> FloatArray:
        """Return the torques (M, J) of a weight vector."""
        return (self.unweighted.columns(indices) @ x).reshape(self.tau.shape[1], -1).T

    def select(self, keep: BoolArray) -> SparseProblem:
        """Return the problem of some of the samples."""
        return replace(self, q=self.q[keep], tau=self.tau[keep], runs=self.runs[keep],
                       fold=self.fold[keep])


@dataclass(frozen=True, eq=False)
class SupportFit:
    """A support with its refit, its residual (M, J) and the noise sigma (J,) in N·m."""

    refit: support.Refit
    residual: FloatArray
    sigma: FloatArray
    rounds: int


@dataclass(frozen=True, eq=False)
class SparseFit:
    """
    Coefficients `x` (K,) of features `indices`: the selected support and its equivalents.

    The equivalents, of `n_equivalent` supports, have the coefficient 0.
    """

    indices: IntArray
    x: FloatArray
    lasso: LassoSolution
    inflation: float
    rounds: int
    n_equivalent: int


def grow(problem: SparseProblem) -> SupportFit:
    """
    Return the selected support, grown from nothing, as for independent samples.

    :raises FitError: if there are no samples.
    """
    if not problem.tau.size:
        raise FitError('no samples to fit')
    sigma = noise.remaining_std(problem.tau, np.zeros(problem.tau.shape[1]),
                                noise.floor(problem.tau))
    proposal = propose(*problem.weighted(sigma, 1.0), problem).indices
    refit = replace(support.Refit.empty(), indices=proposal)
    return _converged(problem, SupportFit(refit, problem.tau, sigma, 0), 1.0)


def prune(problem: SparseProblem, grown: SupportFit, inflation: float) -> SupportFit:
    """Return the support that remains with a variance inflation factor."""
    return _converged(problem, grown, inflation) if inflation > 1.0 else grown


def finish(problem: SparseProblem, fit: SupportFit, inflation: float) -> SparseFit:
    """Solve the L1 problem at the final noise, keep the better support, add its equivalents."""
    design, b = problem.weighted(fit.sigma, inflation)
    solution = propose(design, b, problem)
    gram = support.gram_of(design, problem.usable)
    finals = [support.select_support(design, b, start, problem.n_joints, problem.usable, gram)
              for start in (fit.refit.indices, solution.indices)]
    best = min(finals, key=lambda r: support.score(r, problem.n_joints, design.n_rows))
    near = support.equivalents(b, best, problem.n_joints, gram)
    indices = np.unique(np.concatenate([best.indices, *near]))
    x = np.zeros(len(indices))
    x[np.searchsorted(indices, best.indices)] = best.x
    return SparseFit(indices, x, solution, inflation, fit.rounds, len(near))


def propose(design: Design, b: FloatArray, problem: SparseProblem) -> LassoSolution:
    """Solve the L1 problem by ADMM for the universal lambda, sqrt(2 ln 3^N) noise levels."""
    lam = float(np.sqrt(2.0 * problem.n_joints * np.log(3.0)))
    return LassoProblem(design, b, problem.usable).solve(lam)


def _converged(problem: SparseProblem, fit: SupportFit, inflation: float) -> SupportFit:
    """Select the support and estimate the noise in turn, until both converge."""
    for rounds in range(1, _ROUNDS + 1):
        design, b = problem.weighted(fit.sigma, inflation)
        refit = support.select_support(design, b, fit.refit.indices, problem.n_joints,
                                       problem.usable)
        last, fit = fit, _with_noise(problem, refit, fit.rounds + 1)
        if rounds > 1 and np.array_equal(refit.indices, last.refit.indices) \
                and np.allclose(fit.sigma, last.sigma, rtol=_CONVERGED):
            break
    return fit


def _with_noise(problem: SparseProblem, refit: support.Refit, rounds: int) -> SupportFit:
    """Return a refit with its residual and the noise estimated from it."""
    columns = problem.unweighted.columns(refit.indices)
    residual = problem.tau - (columns @ refit.x).reshape(problem.tau.shape[1], -1).T
    sigma = noise.remaining_std(residual, _spent(columns, problem), noise.floor(problem.tau))
    return SupportFit(refit, residual, sigma, rounds)


def _spent(columns: FloatArray, problem: SparseProblem) -> FloatArray:
    """Return the degrees of freedom (J,) of K columns (R, K), shared among the torques."""
    m, j = problem.tau.shape
    acts = (columns.reshape(j, m, columns.shape[1]) != 0.0).any(axis=1)
    sharing = np.maximum(acts.sum(axis=0), 1)
    return np.asarray((acts / sharing).sum(axis=1))
