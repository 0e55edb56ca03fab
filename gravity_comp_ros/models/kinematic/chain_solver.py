"""
Levenberg-Marquardt solver for the chain, with its moments eliminated, and nuisance columns.

    minimise  sum ((tau - tau(A, h)) / sigma)^2 + |h|^2 / s^2

over rotations A and moments h. For given A the torque is linear in h, so h is solved for after
every step and only 2N angles are searched (variable projection, in the form of Ruhe and Wedin,
SIAM Review 22 (1980), algorithm 2: the step comes from the full Jacobian). s is far larger than
any moment of the arm: it sets unidentifiable moments to 0 and hardly affects the others.

Nuisance columns Z of a joint (generic friction, offset and inertia; rows in units of the noise)
have coefficients c ~ N(0, S^2), so that its torque has the covariance I + Z S^2 Z.T. With
Z S = U s V.T the products of whitened rows a and b are

    a . b - (B.T a) . (B.T b),    B = U s (1 + s^2)^(-1/2),

and the columns themselves are never whitened.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics, tilt
from gravity_comp_ros.models.least_squares import lstsq, svd
import numpy as np
from scipy.linalg import lapack


@dataclass(frozen=True, eq=False)
class Nuisance:
    """
    C nuisance columns of each joint, which act on that joint only.

    `columns` (N, C, M) are torques per unit of coefficient; `spread` (C,) are the prior standard
    deviations of the coefficients, per N·m of noise: a noise that is overestimated, by the first
    guess or an unmodelled effect, must not suppress friction.
    """

    columns: FloatArray
    spread: FloatArray

    @classmethod
    def none(cls, n_joints: int, n_samples: int) -> Nuisance:
        """Return no columns."""
        return cls(np.zeros((n_joints, 0, n_samples)), np.zeros(0))

    def select(self, keep: IntArray) -> Nuisance:
        """Return the columns of some of the samples."""
        return replace(self, columns=self.columns[:, :, keep])

    def of_joints(self, joints: list[int]) -> Nuisance:
        """Return the columns of joints in another order."""
        return replace(self, columns=self.columns[joints])


class WeightedNuisance:
    """
    Nuisance columns with rows in units of the noise.

    :param weights: (N, M) 1 / sigma.
    """

    def __init__(self, nuisance: Nuisance, weights: FloatArray) -> None:
        self._columns = nuisance.columns
        self._inside: list[FloatArray] = []        # B (M, C) of each joint
        self._coefficients: list[FloatArray] = []  # (C, M), times a target in units of the noise
        for plain, weight in zip(nuisance.columns, weights):
            rows = plain * weight
            lengths = np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
            spread = nuisance.spread * np.linalg.norm(plain, axis=1) / lengths
            u, s, vt = svd((spread[:, None] * rows).T)
            self._inside.append(u * (s / np.sqrt(1.0 + s ** 2)))
            self._coefficients.append(spread[:, None] * (vt.T * (s / (1.0 + s ** 2))) @ u.T)

    def inside(self, rows: FloatArray) -> FloatArray:
        """Return B.T a of rows a (L, N, M), joint by joint: (L, N C)."""
        return np.concatenate([rows[:, joint] @ inside
                               for joint, inside in enumerate(self._inside)], axis=1)

    def whitened(self, row: FloatArray) -> FloatArray:
        """Return r - B B.T r of a row r (N, M)."""
        return np.stack([own - inside @ (own @ inside)
                         for own, inside in zip(row, self._inside)])

    def torque(self, target: FloatArray) -> FloatArray:
        """Return the most probable torque (N, M) in N·m, for a target (N, M) in noise units."""
        return np.stack([coefficients @ own @ columns for coefficients, own, columns
                         in zip(self._coefficients, target, self._columns)])


# Prior standard deviation of a moment, as a multiple of the largest torque.
_MOMENT_STD = 2.0
# Prior standard deviation of an angle, in rad.
_ANGLE_STD = 1.0
# Maximum rotation of an axis in one step, in rad.
_MAX_STEP = 0.7
# Factors of the damping after a successful and a failed step, and maximum number of failed steps.
_SHRINK, _GROW, _TRIES = 0.2, 5.0, 8


@dataclass(frozen=True)
class SolveOptions:
    """Limits: `max_steps`, and the relative decrease of the cost that counts as converged."""

    max_steps: int = 60
    tolerance: float = 1e-4


@dataclass(frozen=True, eq=False)
class ChainProblem:
    """
    Torques `tau` (M, N) in N·m of poses `q` (M, N), with weights 1 / sigma (M, N).

    Columns and target are whitened against the `nuisance` columns.
    """

    q: FloatArray
    tau: FloatArray
    weights: FloatArray
    nuisance: Nuisance | None = None
    moment_precision: float = field(init=False)

    def __post_init__(self) -> None:
        largest = max(float(np.abs(self.tau).max(initial=0.0)), 1e-9)
        object.__setattr__(self, 'moment_precision', (_MOMENT_STD * largest) ** -2)

    @property
    def n_joints(self) -> int:
        return self.q.shape[1]

    def prior_precision(self) -> FloatArray:
        """Return the diagonal (4N,) of the prior precision of a step."""
        n = self.n_joints
        return np.concatenate([np.full(2 * n, _ANGLE_STD ** -2),
                               np.full(2 * n, self.moment_precision)])

    def rows(self, weighted: FloatArray) -> Rows:
        """Return a Jacobian (K, N, M) in units of the noise as the rows of the problem."""
        return Rows(weighted.reshape(len(weighted), self.tau.size),
                    self.weighted_nuisance.inside(weighted))

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
    def weighted_nuisance(self) -> WeightedNuisance:
        """Return the nuisance columns in units of the noise."""
        none = Nuisance.none(self.n_joints, len(self.q))
        return WeightedNuisance(self.nuisance or none, self.row_weights)

    def with_weights(self, weights: FloatArray) -> ChainProblem:
        """Return the same problem with other weights (M, N)."""
        return replace(self, weights=weights)

    def select(self, keep: IntArray) -> ChainProblem:
        """Return the problem of some of the samples."""
        nuisance = None if self.nuisance is None else self.nuisance.select(keep)
        return ChainProblem(self.q[keep], self.tau[keep], self.weights[keep], nuisance)

    def residual(self, chain: Chain) -> FloatArray:
        """Return the residual (M, N) in N·m of a chain and the nuisance terms."""
        residual = self.tau - chain.torque(self.q)
        return residual - self.weighted_nuisance.torque(self.row_weights * residual.T).T


@dataclass(frozen=True, eq=False)
class Rows:
    """
    Columns of the regressor, transposed: `full` (K, N M), and their nuisance part (K, K').

    They yield the products of the whitened columns without computing the columns themselves.
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

    `free` (4N,) masks the parameters of a step that were free; the others were fixed.
    """

    problem: ChainProblem
    chain: Chain
    cost: float
    steps: int
    free: BoolArray

    @cached_property
    def precision(self) -> FloatArray:
        """Return the precision (4N, 4N) of a step from the chain."""
        problem, kinematics = self.problem, _kinematics(self.problem, self.chain.axes)
        parts = (kinematics.axis_columns(self.chain.moments, problem.row_weights),
                 kinematics.moment_columns(weights=problem.row_weights))
        return problem.rows(np.concatenate(parts)).gram() + np.diag(problem.prior_precision())


def solve(problem: ChainProblem, axes: FloatArray, free: BoolArray | None = None,
          options: SolveOptions = SolveOptions()) -> Solution:
    """
    Return the minimum that Levenberg-Marquardt reaches from `axes` (N, 3, 3).

    :param free: mask (4N,) of a step's free parameters; fixed moments are 0.
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
    kinematics: ForwardKinematics
    moments: FloatArray
    rows: Rows
    gram: FloatArray
    residual: FloatArray
    cost: float


class _Search:
    def __init__(self, problem: ChainProblem, free: BoolArray) -> None:
        self.problem = problem
        self.b = problem.target()
        self.whitened = problem.weighted_nuisance.whitened(self.b).ravel()
        n = problem.n_joints
        self.free_axes, self.free_moments = free[:2 * n], free[2 * n:]

    def at(self, axes: FloatArray) -> _Point:
        problem = self.problem
        kinematics = _kinematics(problem, axes)
        rows = problem.rows(_selected(kinematics.moment_columns(weights=problem.row_weights),
                                      self.free_moments))
        gram = rows.gram()
        # Keeps it positive definite under rounding where the noise is tiny.
        gram.flat[::len(gram) + 1] += problem.moment_precision + 1e-14 * gram.max(initial=0.0)
        free = _solved(gram, rows.full @ self.whitened)
        residual = self.b - (free @ rows.full).reshape(self.b.shape)
        whitened = problem.weighted_nuisance.whitened(residual).ravel()
        moments = np.zeros(self.free_moments.shape)
        moments[self.free_moments] = free
        cost = float(residual.ravel() @ whitened) + float(
            problem.moment_precision * (free @ free))
        return _Point(axes, kinematics, moments.reshape(-1, 2), rows, gram, whitened, cost)

    def step(self, point: _Point, damping: float) -> tuple[_Point | None, float]:
        """Return the next point, or None where no step lowers the cost, and the damping."""
        n_axes = int(self.free_axes.sum())
        if not n_axes:
            return None, damping
        axes = self.problem.rows(_selected(
            point.kinematics.axis_columns(point.moments, self.problem.row_weights),
            self.free_axes))
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
        gram.flat[:n_axes * len(gram):len(gram) + 1] += _ANGLE_STD ** -2
        diagonal = gram.diagonal()[:n_axes].copy()
        for _ in range(_TRIES):
            gram.flat[:n_axes * len(gram):len(gram) + 1] = diagonal + damping * stiffness
            d = np.zeros(self.free_axes.shape)
            d[self.free_axes] = np.linalg.solve(gram, gradient)[:n_axes]
            d *= min(1.0, _MAX_STEP / max(float(np.abs(d).max()), 1e-300))
            tried = self.at(point.axes @ tilt(d.reshape(-1, 2)))
            if tried.cost < point.cost:
                return tried, max(_SHRINK * damping, 1e-12)
            damping = max(_GROW * damping, 1e-6)
        return None, damping


def _solved(gram: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution of normal equations (K, K), of minimum norm if they are singular."""
    if not len(gram):
        return np.zeros(0)
    _, x, failed = lapack.dposv(gram, right)
    return np.asarray(lstsq(gram, right, rcond=1e-13) if failed else x)


def _kinematics(problem: ChainProblem, axes: FloatArray) -> ForwardKinematics:
    return ForwardKinematics(axes, problem.q, problem.sin_cos)


def _selected(columns: FloatArray, mask: BoolArray) -> FloatArray:
    """Return the columns of a mask, without a copy if it selects all."""
    return columns if mask.all() else columns[mask]


def _orthogonal(axes: FloatArray) -> FloatArray:
    """Return the nearest rotations: products of many are no longer orthogonal after rounding."""
    u, _, vt = np.linalg.svd(axes)
    return np.asarray(u @ vt)
