"""
From samples to a sparse weight vector: noise, L1 problem, support, refit.

The steps feed each other. The noise gives the row weights and lambda; ADMM solves the L1 problem
(Yu 2022, Eqs. 8-14), which proposes features; the support is settled by description length and
refitted without the penalty; the residual gives the noise anew. Two or three rounds settle it.
Where supports tie, their refits are averaged with the weights that their scores give them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gravity_comp_ros.errors import FitError, OptionError
from gravity_comp_ros.gravity import admm, noise, support
from gravity_comp_ros.gravity.design import Design
from gravity_comp_ros.gravity.lasso import LassoProblem, LassoSolution
from gravity_comp_ros.samples import BoolArray, FloatArray, IntArray

DesignType = Callable[[FloatArray, FloatArray], Design]

_ROUNDS = 20
_PATH_STEPS = 8
_LOOSE = 1e-2


@dataclass(frozen=True)
class SparseOptions:
    """
    How a sparse fit is made.

    `lam` is lambda in units of the noise, or None for the universal sqrt(2 ln 3^N);
    `inflation` says how many samples count as one (correlated residuals), at least 1.

    :raises OptionError: if a value is out of range.
    """

    lam: float | None = None
    inflation: float = 1.0
    admm: admm.AdmmOptions = admm.AdmmOptions()

    def __post_init__(self) -> None:
        if self.lam is not None and not 0.0 < self.lam < np.inf:
            raise OptionError(f'lambda is {self.lam}; it must be positive')
        if not 1.0 <= self.inflation < np.inf:
            raise OptionError(f'inflation is {self.inflation}; it must be at least 1')


@dataclass(frozen=True)
class SparseFit:
    """Coefficients `x` (K,) of features `indices`, and how they came about."""

    indices: IntArray
    x: FloatArray
    covariance: FloatArray
    noise: noise.NoiseModel
    predicted: FloatArray
    lasso: LassoSolution
    rounds: int
    ties: int


@dataclass(frozen=True)
class SparseProblem:
    """
    Torques `tau` (M, J) of poses `q` (M, N), explained by a kind of design.

    J is 1 for the features of one joint and N for those of one energy. `usable` masks the 3^N
    features that may be taken.
    """

    design_type: DesignType
    q: FloatArray
    tau: FloatArray
    usable: BoolArray

    def weighted(self, model: noise.NoiseModel, predicted: FloatArray,
                 inflation: float) -> tuple[Design, FloatArray, FloatArray]:
        """Return the design and right-hand side in units of the noise, and the weights."""
        weights = 1.0 / (model.sigma(predicted) * np.sqrt(inflation))
        return (self.design_type(self.q, weights), (weights * self.tau).T.ravel(), weights)

    def predict(self, indices: IntArray, x: FloatArray) -> FloatArray:
        """Return the torques (M, J) of a weight vector."""
        plain = self.design_type(self.q, np.ones(self.tau.shape))
        return (plain.columns(indices) @ x).reshape(self.tau.shape[1], -1).T


def fit_sparse(problem: SparseProblem, options: SparseOptions = SparseOptions()) -> SparseFit:
    """
    Return the sparse fit of `problem`.

    :raises FitError: if there are no samples.
    """
    if not problem.tau.size:
        raise FitError('no samples to fit')
    least = noise.floor(problem.tau)
    model, predicted = noise.first_guess(problem.tau), np.zeros(problem.tau.shape)
    chosen = np.zeros(0, dtype=np.int64)
    for rounds in range(1, _ROUNDS + 1):
        design, b, _ = problem.weighted(model, predicted, options.inflation)
        if rounds == 1:
            solution = propose(design, b, problem, options)
            chosen = solution.indices
        refit = support.settle(design, b, chosen, problem.q.shape[1], problem.usable)
        predicted = problem.predict(refit.indices, refit.x)
        last, model = model, noise.estimate(problem.tau - predicted, predicted, least,
                                            spent(refit, problem))
        same = np.array_equal(refit.indices, chosen)
        chosen = refit.indices
        if same and rounds > 1 and _is_close(last, model):
            break
    design, b, _ = problem.weighted(model, predicted, options.inflation)
    solution = propose(design, b, problem, options)
    return _finish(problem, design, b, chosen, solution, model, rounds)


def propose(design: Design, b: FloatArray, problem: SparseProblem,
            options: SparseOptions) -> LassoSolution:
    """Solve the L1 problem by ADMM, along a falling lambda that ends at the wanted one."""
    n_joints = problem.q.shape[1]
    lam = options.lam or float(np.sqrt(2.0 * n_joints * np.log(3.0)))
    lasso = LassoProblem(design, b, problem.usable, options.admm)
    top = 0.5 * lasso.lambda_max
    path = np.geomspace(top, lam, _PATH_STEPS)[:-1] if top > lam else np.zeros(0)
    for step in path:
        lasso.solve(float(step), _LOOSE)
    return lasso.solve(lam, options.admm.tolerance)


def spent(refit: support.Refit, problem: SparseProblem) -> FloatArray:
    """Return the degrees of freedom that each of the J torques spent on the refit."""
    plain = problem.design_type(problem.q, np.ones(problem.tau.shape))
    m, j = problem.tau.shape
    blocks = plain.columns(refit.indices).reshape(j, m, len(refit.indices))
    touched = (np.abs(blocks) > 0.0).any(axis=1)
    sharing = np.maximum(touched.sum(axis=0), 1)
    return (touched / sharing).sum(axis=1)


def _finish(problem: SparseProblem, design: Design, b: FloatArray, chosen: IntArray,
            solution: LassoSolution, model: noise.NoiseModel, rounds: int) -> SparseFit:
    """Settle from both proposals, keep the better, and average what ties with it."""
    n_joints = problem.q.shape[1]
    finals = [support.settle(design, b, start, n_joints, problem.usable)
              for start in (chosen, solution.indices)]
    best = min(finals, key=lambda r: support.score(r, n_joints, design.n_rows))
    average, ties = support.average_ties(design, b, best, n_joints, problem.usable)
    predicted = problem.predict(average.indices, average.x)
    return SparseFit(average.indices, average.x, average.covariance, model, predicted,
                     solution, rounds, ties)


def _is_close(a: noise.NoiseModel, b: noise.NoiseModel) -> bool:
    return bool(np.allclose(a.absolute, b.absolute, rtol=0.05)
                and np.allclose(a.relative, b.relative, rtol=0.1, atol=1e-4))
