"""
Sparse fits: of one potential energy for all joints, or of one sum for each joint's torque.

Potential: U = sum_k theta_k phi_k(q), tau_n = dU/dq_n. All joints share theta, so the data of each
joint determine the others as well. Non-conservative torques (friction) and offsets cannot be
represented and remain in the residual.

Per joint: tau_n = F beta_n over all 3^N features (Yu 2022, Eqs. 5-9). It is accurate within the
trained range. Outside, the joints' torques are not coupled, and the error can exceed the torque
itself.

The steps of a fit are iterated. The noise determines the row weights and lambda. ADMM solves the
L1 problem (Yu 2022, Eqs. 8-14). Within its working set the support is selected by description
length and refitted without the penalty, which removes the shrinkage. The residual yields the next
noise estimate. The initial noise is the torque itself and falls from round to round, so each round
explains the coarser part of the residual, and noise is not fitted as signal.

An autocorrelated residual (friction, hysteresis, drift) is overfitted by the growing support, with
large errors on the next run. So the iteration goes on with the variance inflated by the residual's
correlation time, which multiplies every price, and prunes the support.

Features that could replace one of the support at nearly the same score are added to it in the end:
the regression that estimates the weights of all of them (`regression.dictionary_columns`) averages
over them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models import noise
from gravity_comp_ros.models.sparse.dictionary import (
    Expansion, usable_for_energy, usable_for_torque)
from gravity_comp_ros.models.sparse.lasso import LassoProblem, LassoSolution
from gravity_comp_ros.models.sparse.regressor import Design, EnergyDesign, TorqueDesign
from gravity_comp_ros.models.sparse.support import select_support, Support
import numpy as np

# Maximum number of rounds, and relative change of the noise at which they end.
_ROUNDS, _CONVERGED = 20, 0.05


def fit_potential(samples: JointSamples) -> tuple[Expansion, list[SparseFit]]:
    """
    Fit one sparse potential energy to the torques of all joints.

    :return: the energy in J, and its sparse fit.
    :raises FitError: if there are no samples.
    """
    fit = fit_sparse(SparseProblem(EnergyDesign, samples.q, samples.tau, samples.runs,
                                   usable_for_energy(samples.q)))
    return Expansion(fit.indices, fit.x), [fit]


def fit_per_joint(samples: JointSamples) -> tuple[tuple[Expansion, ...], list[SparseFit]]:
    """
    Fit each joint's torque separately.

    :return: one expansion per joint in N·m, and their sparse fits.
    :raises FitError: if there are no samples.
    """
    usable = usable_for_torque(samples.q)
    fits = [fit_sparse(SparseProblem(TorqueDesign, samples.q, samples.tau[:, [joint]],
                                     samples.runs, usable))
            for joint in range(samples.n_joints)]
    return tuple(Expansion(fit.indices, fit.x) for fit in fits), fits


def fit_sparse(problem: SparseProblem) -> SparseFit:
    """
    Return the sparse fit of `problem`.

    :raises FitError: if there are no samples.
    """
    if not problem.tau.size:
        raise FitError('no samples to fit')
    start = _Round(None, None, problem.tau, noise.remaining_std(
        problem.tau, np.zeros(problem.tau.shape[1]), noise.floor(problem.tau)), 0)
    fit, inflation = _converged(problem, start, 1.0), 1.0
    time = float(np.median(noise.correlation_times(fit.residual, problem.runs)))
    if time >= noise.WHITE:
        inflation = time
        fit = _converged(problem, fit, inflation)
    assert fit.support is not None and fit.lasso is not None
    best, near = fit.support, fit.support.equivalent
    indices = np.union1d(best.indices, near)
    x = np.zeros(len(indices))
    x[np.searchsorted(indices, best.indices)] = best.x
    return SparseFit(indices, x, fit.lasso, inflation, fit.rounds, len(near))


DesignType = Callable[[FloatArray, FloatArray], Design]


@dataclass(frozen=True, eq=False)
class SparseProblem:
    """
    Torques `tau` (M, J) of poses `q` (M, N), with the type of design to explain them.

    J is 1 for the features of one joint and N for those of one energy. `usable` masks the 3^N
    features that may be selected; `runs` (M,) numbers the run of each sample.
    """

    design_type: DesignType
    q: FloatArray
    tau: FloatArray
    runs: IntArray
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


@dataclass(frozen=True, eq=False)
class SparseFit:
    """
    Coefficients `x` (K,) of features `indices`: the selected support and its equivalents.

    The equivalents, `n_equivalent` features, have the coefficient 0.
    """

    indices: IntArray
    x: FloatArray
    lasso: LassoSolution
    inflation: float
    rounds: int
    n_equivalent: int


@dataclass(frozen=True, eq=False)
class _Round:
    """A support, the L1 solution that proposed it, residual (M, J), and noise (J,) in N·m."""

    support: Support | None
    lasso: LassoSolution | None
    residual: FloatArray
    sigma: FloatArray
    rounds: int


def _converged(problem: SparseProblem, last: _Round, inflation: float) -> _Round:
    """Select the support and estimate the noise in turn, until both converge."""
    lam = float(np.sqrt(2.0 * problem.n_joints * np.log(3.0)))  # the universal lambda
    for number in range(_ROUNDS):
        design, b = problem.weighted(last.sigma, inflation)
        lasso = LassoProblem(design, b, problem.usable)
        solution = lasso.solve(lam)
        starts = [solution.indices, *([last.support.indices] if last.support else [])]
        support = select_support(lasso, problem.n_joints, *starts)
        columns = problem.unweighted.columns(support.indices)
        residual = problem.tau - (columns @ support.x).reshape(problem.tau.shape[1], -1).T
        sigma = noise.remaining_std(residual, _spent(columns, problem), noise.floor(problem.tau))
        before, last = last, _Round(support, solution, residual, sigma, last.rounds + 1)
        if number and before.support is not None \
                and np.array_equal(support.indices, before.support.indices) \
                and np.allclose(sigma, before.sigma, rtol=_CONVERGED):
            break
    return last


def _spent(columns: FloatArray, problem: SparseProblem) -> FloatArray:
    """Return the degrees of freedom (J,) of K columns (R, K), shared among the torques."""
    m, j = problem.tau.shape
    acts = (columns.reshape(j, m, columns.shape[1]) != 0.0).any(axis=1)
    sharing = np.maximum(acts.sum(axis=0), 1)
    return np.asarray((acts / sharing).sum(axis=1))
