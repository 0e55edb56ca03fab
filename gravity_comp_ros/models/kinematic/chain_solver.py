"""
Levenberg-Marquardt for the chain, with its moments eliminated.

    minimise  sum ((tau - tau(A, h)) / sigma)^2 + |h|^2 / s^2

over rotations A and moments h. For given A the torque is linear in h, so h is solved for after
every step and only 2N angles are searched (variable projection, in the form of Ruhe and Wedin,
SIAM Review 22 (1980), algorithm 2: the step comes from the full Jacobian). s is far larger than
any moment of the arm: it keeps moments that no torque shows at 0 and leaves the others alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics, tilt
from gravity_comp_ros.models.least_squares import lstsq
from gravity_comp_ros.models.sparse.weighted_nuisance import WeightedNuisance
import numpy as np
from scipy.linalg import lapack

# Moments are kept under about this many times the largest torque.
_LOOSE_MOMENT = 2.0
# No axis turns further in one step, rad.
_LONGEST_STEP = 0.7
# A direction that no torque shows is taken as known to a radian.
_ANGLE_SPREAD = 1.0
_SHRINK, _GROW, _TRIES = 0.2, 5.0, 8


@dataclass(frozen=True)
class SolveOptions:
    """When to stop: after `max_steps`, or when a step gains less than this share of the cost."""

    max_steps: int = 100
    tolerance: float = 1e-6


@dataclass(frozen=True, eq=False)
class ChainProblem:
    """
    Torques `tau` (M, N) in N·m of poses `q` (M, N), with weights 1 / sigma (M, N).

    `nuisance` (K, N, M) are torques per unit of coefficients beside gravity, `spread` (K,) their
    standard deviations before any data, per N·m of noise (None: all are free). Columns and target
    are whitened against them (`models.sparse.projected`).
    """

    q: FloatArray
    tau: FloatArray
    weights: FloatArray
    nuisance: FloatArray | None = None
    spread: FloatArray | None = None
    moment_precision: float = field(init=False)

    def __post_init__(self) -> None:
        largest = max(float(np.abs(self.tau).max(initial=0.0)), 1e-9)
        object.__setattr__(self, 'moment_precision', (_LOOSE_MOMENT * largest) ** -2)

    @property
    def n_joints(self) -> int:
        return self.q.shape[1]

    def prior_precision(self) -> FloatArray:
        """Return the diagonal (4N,) of what is known of a step without data."""
        n = self.n_joints
        return np.concatenate([np.full(2 * n, _ANGLE_SPREAD ** -2),
                               np.full(2 * n, self.moment_precision)])

    def rows(self, weighted: FloatArray) -> Rows:
        """Return a Jacobian (K, N, M) in units of the noise as the rows of the problem."""
        return Rows(weighted.reshape(len(weighted), self.tau.size),
                    self.beside.inside(weighted))

    @cached_property
    def row_weights(self) -> FloatArray:
        """Return the weights (N, M), a row for each joint."""
        return np.ascontiguousarray(self.weights.T)

    @cached_property
    def sin_cos(self) -> tuple[FloatArray, FloatArray]:
        """Return the sines and cosines (N, M) of all poses."""
        q = np.ascontiguousarray(self.q.T)
        return np.sin(q), np.cos(q)

    def target(self) -> FloatArray:
        """Return the torques in units of the noise, shape (N, M)."""
        return self.row_weights * self.tau.T

    @cached_property
    def beside(self) -> WeightedNuisance:
        """Return the nuisance columns in units of the noise."""
        return WeightedNuisance(self.nuisance, self.row_weights, self.spread)

    def with_weights(self, weights: FloatArray) -> ChainProblem:
        """Return the same problem with other weights (M, N)."""
        return ChainProblem(self.q, self.tau, weights, self.nuisance, self.spread)

    def select(self, keep: IntArray) -> ChainProblem:
        """Return the problem of some of the samples."""
        nuisance = None if self.nuisance is None else self.nuisance[:, :, keep]
        return ChainProblem(self.q[keep], self.tau[keep], self.weights[keep], nuisance,
                            self.spread)

    def nuisance_coefficients(self, chain: Chain) -> FloatArray:
        """Return the coefficients (K,) that fit best beside the gravity of a chain."""
        return self._coefficients(self.tau - chain.torque(self.q))

    def residual(self, chain: Chain) -> FloatArray:
        """Return what a chain and the nuisance terms leave of the torque, (M, N) in N·m."""
        left = self.tau - chain.torque(self.q)
        if self.nuisance is None:
            return left
        return np.asarray(left - np.tensordot(self._coefficients(left), self.nuisance,
                                              axes=(0, 0)).T)

    def _coefficients(self, left: FloatArray) -> FloatArray:
        return self.beside.coefficients(self.row_weights * left.T)


@dataclass(frozen=True, eq=False)
class Rows:
    """
    Columns of the regressor, transposed: `full` (K, N M), and their `inside` (K, K') of nuisance.

    Of the whitened columns only products are needed, which these two give for less.
    """

    full: FloatArray
    inside: FloatArray

    def gram(self) -> FloatArray:
        """Return the products (K, K) of the whitened columns."""
        return np.asarray(self.full @ self.full.T - self.inside @ self.inside.T)

    def cross(self, other: Rows) -> FloatArray:
        """Return the products (K, L) with the whitened columns of another part."""
        return np.asarray(self.full @ other.full.T - self.inside @ other.inside.T)


@dataclass(frozen=True, eq=False)
class Solution:
    """
    A minimum of a problem: the chain and its cost.

    `free` (4N,) masks the numbers that were searched; the others were held.
    """

    problem: ChainProblem
    chain: Chain
    cost: float
    steps: int
    free: BoolArray

    @cached_property
    def precision(self) -> FloatArray:
        """Return the precision (4N, 4N) of a step from the chain."""
        problem, sweep = self.problem, _sweep(self.problem, self.chain.axes)
        parts = (sweep.axis_columns(self.chain.moments, problem.row_weights),
                 sweep.moment_columns(weights=problem.row_weights))
        return problem.rows(np.concatenate(parts)).gram() + np.diag(problem.prior_precision())


def solve(problem: ChainProblem, axes: FloatArray, free: BoolArray | None = None,
          options: SolveOptions = SolveOptions()) -> Solution:
    """
    Return the minimum that Levenberg-Marquardt reaches from `axes` (N, 3, 3).

    :param free: which of a step's numbers (4N,) may move; moments that may not are 0.
    """
    n = problem.n_joints
    free = np.ones(4 * n, dtype=bool) if free is None else free
    search = _Search(problem, free)
    point, damping, steps = search.at(axes), 1e-2, 0
    for steps in range(1, options.max_steps + 1):
        better, damping = search.step(point, damping)
        if better is None:
            break
        gain, point = point.cost - better.cost, better
        if gain < options.tolerance * point.cost:
            break
    return Solution(problem, Chain(_orthogonal(point.axes), point.moments), point.cost,
                    steps, free)


@dataclass(frozen=True, eq=False)
class _Point:
    """Axes with the best moments for them; `residual` (N M,) is whitened (`ChainProblem`)."""

    axes: FloatArray
    sweep: ForwardKinematics
    moments: FloatArray
    rows: Rows
    gram: FloatArray
    residual: FloatArray
    cost: float


class _Search:
    def __init__(self, problem: ChainProblem, free: BoolArray) -> None:
        self.problem = problem
        self.b = problem.target()
        self.whitened = problem.beside.whitened(self.b).ravel()
        n = problem.n_joints
        self.free_axes, self.free_moments = free[:2 * n], free[2 * n:]

    def at(self, axes: FloatArray) -> _Point:
        problem = self.problem
        sweep = _sweep(problem, axes)
        rows = problem.rows(_chosen(sweep.moment_columns(weights=problem.row_weights),
                                    self.free_moments))
        gram = rows.gram()
        # Rounding must not make it indefinite where the noise is next to nothing.
        gram.flat[::len(gram) + 1] += problem.moment_precision + 1e-14 * gram.max(initial=0.0)
        found = _solved(gram, rows.full @ self.whitened)
        left = self.b - (found @ rows.full).reshape(self.b.shape)
        residual = problem.beside.whitened(left).ravel()
        moments = np.zeros(self.free_moments.shape)
        moments[self.free_moments] = found
        cost = float(left.ravel() @ residual) + float(problem.moment_precision * (found @ found))
        return _Point(axes, sweep, moments.reshape(-1, 2), rows, gram, residual, cost)

    def step(self, point: _Point, damping: float) -> tuple[_Point | None, float]:
        """Return the next point, or None where no step lowers the cost, and the damping."""
        n_axes = int(self.free_axes.sum())
        if not n_axes:
            return None, damping
        axes = self.problem.rows(_chosen(
            point.sweep.axis_columns(point.moments, self.problem.row_weights), self.free_axes))
        gram = np.empty((n_axes + len(point.gram),) * 2)
        gram[:n_axes, :n_axes] = axes.gram()
        gram[:n_axes, n_axes:] = axes.cross(point.rows)
        gram[n_axes:, :n_axes] = gram[:n_axes, n_axes:].T
        gram[n_axes:, n_axes:] = point.gram
        gradient = np.concatenate([axes.full @ point.residual, point.rows.full @ point.residual])
        gradient[n_axes:] -= self.problem.moment_precision * point.moments.ravel()[
            self.free_moments]
        stiffness = np.diag(gram)[:n_axes].copy()
        stiffness += 1e-9 * stiffness.max() + 1e-300
        gram.flat[:n_axes * len(gram):len(gram) + 1] += _ANGLE_SPREAD ** -2
        diagonal = gram.diagonal()[:n_axes].copy()
        for _ in range(_TRIES):
            gram.flat[:n_axes * len(gram):len(gram) + 1] = diagonal + damping * stiffness
            d = np.zeros(self.free_axes.shape)
            d[self.free_axes] = np.linalg.solve(gram, gradient)[:n_axes]
            d *= min(1.0, _LONGEST_STEP / max(float(np.abs(d).max()), 1e-300))
            tried = self.at(point.axes @ tilt(d.reshape(-1, 2)))
            if tried.cost < point.cost:
                return tried, max(_SHRINK * damping, 1e-12)
            damping = max(_GROW * damping, 1e-6)
        return None, damping


def _solved(gram: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of normal equations (K, K), the shortest one where they are singular."""
    if not len(gram):
        return np.zeros(0)
    _, found, failed = lapack.dposv(gram, right)
    return np.asarray(lstsq(gram, right, rcond=1e-13) if failed else found)


def _sweep(problem: ChainProblem, axes: FloatArray) -> ForwardKinematics:
    return ForwardKinematics(axes, problem.q, problem.sin_cos)


def _chosen(columns: FloatArray, mask: BoolArray) -> FloatArray:
    """Return the columns of a mask; all of them need no copy."""
    return columns if mask.all() else columns[mask]


def _orthogonal(axes: FloatArray) -> FloatArray:
    """Return the rotations nearest to products of many that rounding has worn."""
    u, _, vt = np.linalg.svd(axes)
    return np.asarray(u @ vt)
