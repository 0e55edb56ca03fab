"""
Levenberg-Marquardt on the gravity of one arm: axes, moments, gains of efforts, tilts of the base.

    effort_n = exp(g_n) gravity_n(axes, moments, base) + Z_n c_n + e_n,    e_n ~ N(0, sigma_n^2)

The columns Z_n of a joint (friction, offset, inertia) have coefficients c_n ~ N(0, sigma_n^2 S^2),
so that the covariance of its efforts is sigma_n^2 (I + Z_n S^2 Z_n'). Its rows are whitened by the
root of that matrix, whatever its noise. The most probable noise is the RMS of the residual r_n,
and what is minimised over M rows is the negative log likelihood

    M sum_n log sigma_n,    sigma_n^2 = |r_n|^2 / M + floor_n^2,

which does not depend on the units of the joints. For given angles and gains the effort is linear
in the moments, which are solved for at every step (variable projection, in the form of A. Ruhe and
P. A. Wedin, SIAM Review 22 (1980), algorithm 2: the step comes from the full Jacobian).

The likelihood of unknown axes has several maxima. Most of the wrong ones have one wrong axis. The
search starts from random axes, and from the best axes with one or two of them replaced, until it
has reached the best maximum several times or the starts are used up.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, spread_over
from gravity_comp_ros.models.kinematic.chain import aligned, Chain, ForwardKinematics, tilt
from gravity_comp_ros.models.least_squares import svd
from gravity_comp_ros.models.noise import correlation_times
import numpy as np

# Largest step of an axis or the base in rad, and of the logarithm of a gain.
_MAX_STEP = 0.7
# Damping of the angles and gains: the first, its factors after a success and a failure, and its
# limits.
_DAMPING, _SHRINK, _GROW, _LOWEST, _HIGHEST = 1e-2, 0.2, 5.0, 1e-9, 1e6
# Share of a column's size that keeps normal equations positive definite under rounding.
_ROUNDING = 1e-13
# Noise estimates at each point, with the moments between them.
_NOISES = 2
# Maximum number of steps, and decrease of the cost in nats at which they end.
_MAX_STEPS, _CONVERGED = 60, 0.3
# Number of samples for a coarse solution.
_COARSE_SAMPLES = 200
# Number of starts from random axes before the best axes are varied.
_RANDOM = 4
# Number of further starts that must reach the best maximum, and distance in nats up to which one
# counts as that. With four a search in ten ends at a wrong maximum.
_HITS, _SAME = 12, 3.0
# Distance in nats from the best maximum up to which another may be that of the true axes: it has
# the least noise by chance, without a prior of right angles.
_NEAR = 10.0
# Difference of gravity at random poses below which two maxima are one, as a share of the largest
# joint torque: Gauss-Newton then reaches the same minimum.
_ONE = 0.02


@dataclass(frozen=True)
class ArmPriors:
    """
    Standard deviations of a step: `tilt` of an axis or the base in rad, `gain` of a logarithm.

    `moment` is that of a moment, as a multiple of the largest effort. It sets moments that are not
    identifiable to 0, and is far larger than those of the arm, also where the efforts have the
    units of several drives.
    """

    tilt: float = 1.0
    gain: float = 3.0
    moment: float = 60.0


@dataclass(frozen=True, eq=False)
class Nuisance:
    """
    C columns of each joint, which act on that joint only.

    `columns` (N, C, M) are torques per unit of coefficient; `spread` (C,) are the prior standard
    deviations of the coefficients per N·m of noise.
    """

    columns: FloatArray
    spread: FloatArray

    @classmethod
    def none(cls, n_joints: int, n_samples: int) -> Nuisance:
        """Return no columns."""
        return cls(np.zeros((n_joints, 0, n_samples)), np.zeros(0))

    def with_column(self, rows: FloatArray, spread: float) -> Nuisance:
        """Return the same with another column (M, N) of each joint."""
        return Nuisance(np.concatenate([self.columns, rows.T[:, None]], axis=1),
                        np.append(self.spread, spread))

    def select(self, keep: IntArray) -> Nuisance:
        """Return the columns of some of the samples."""
        return replace(self, columns=self.columns[:, :, keep])

    def of_joints(self, joints: list[int]) -> Nuisance:
        """Return the columns of joints in another order."""
        return replace(self, columns=self.columns[joints])

    @cached_property
    def _basis(self) -> tuple[FloatArray, FloatArray]:
        """Return orthonormal columns (N, M, K), and the share (N, K) that whitening removes."""
        parts = [svd((self.spread[:, None] * rows).T) for rows in self.columns]
        basis = np.stack([u for u, _, _ in parts])
        sizes = np.stack([s for _, s, _ in parts])
        return basis, 1.0 - 1.0 / np.sqrt(1.0 + sizes ** 2)

    def whitened(self, rows: FloatArray) -> FloatArray:
        """Return rows (P, N, M), whitened."""
        if not len(self.spread):
            return rows
        basis, share = self._basis
        by_joint = rows.swapaxes(0, 1)
        inside = (by_joint @ basis) * share[:, None]
        return np.asarray((by_joint - inside @ basis.swapaxes(1, 2)).swapaxes(0, 1))


@dataclass(frozen=True, eq=False)
class ArmProblem:
    """
    Efforts `tau` (M, N) of poses `q` (M, N) in rad.

    `floor` is the smallest noise (N,), in the unit of the effort. With `has_one_noise` all joints
    have the same noise.
    """

    q: FloatArray
    tau: FloatArray
    nuisance: Nuisance
    floor: FloatArray
    has_one_noise: bool = False
    priors: ArmPriors = ArmPriors()

    @cached_property
    def target(self) -> FloatArray:
        """Return the whitened efforts (N, M)."""
        return self.nuisance.whitened(np.ascontiguousarray(self.tau.T)[None])[0]

    @cached_property
    def sin_cos(self) -> tuple[FloatArray, FloatArray]:
        """Return the sines and cosines (N, M) of all poses."""
        q = np.ascontiguousarray(self.q.T)
        return np.sin(q), np.cos(q)

    @cached_property
    def moment_std(self) -> float:
        """Return the prior standard deviation of a moment, in N·m."""
        return self.priors.moment * max(float(np.abs(self.tau).max(initial=0.0)), 1e-9)

    def noise(self, residual: FloatArray) -> FloatArray:
        """Return the noise (N,) of a whitened residual (N, M)."""
        variance = (residual ** 2).mean(axis=1) + self.floor ** 2
        return np.sqrt(np.full(len(variance), variance.mean()) if self.has_one_noise else variance)

    def select(self, keep: IntArray) -> ArmProblem:
        """Return the problem of some of the samples."""
        return replace(self, q=self.q[keep], tau=self.tau[keep],
                       nuisance=self.nuisance.select(keep))

    def of_joints(self, joints: list[int]) -> ArmProblem:
        """Return the problem of joints in another order."""
        return replace(self, q=self.q[:, joints], tau=self.tau[:, joints],
                       nuisance=self.nuisance.of_joints(joints), floor=self.floor[joints])


@dataclass(frozen=True, eq=False)
class ArmState:
    """
    A chain, logarithms of gains (N,), and `base_tilts` (L, 2) in rad.

    The base at each pose has the sum of the tilts times their shares. `residual` (N, M) is
    whitened; `noise` (N,) and `cost`, in nats, are those of it. `arm` are its frames, and
    `moment_columns` (2N, N, M) the whitened efforts per moment.
    """

    chain: Chain
    log: FloatArray
    base_tilts: FloatArray
    residual: FloatArray
    noise: FloatArray
    cost: float
    arm: ForwardKinematics
    moment_columns: FloatArray

    def times(self, runs: IntArray) -> FloatArray:
        """Return the correlation times (N,) of the residuals, in rows."""
        return correlation_times(self.residual.T, runs)


def cost_of(state: ArmState) -> float:
    return state.cost


@dataclass(frozen=True, eq=False)
class ArmSolver:
    """
    Levenberg-Marquardt on a problem, with unknowns in addition to the moments.

    `axes` (2N,) masks the tilts of the axes, those of the first are the base's; `gains` (K,) are
    the joints with a free gain; `shares` (M, L) are those of each tilt of a moving base.
    """

    problem: ArmProblem
    axes: BoolArray
    gains: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    shares: FloatArray | None = None

    @classmethod
    def of_axes(cls, problem: ArmProblem) -> ArmSolver:
        """Return the solver for all axes and moments."""
        return cls(problem, np.ones(2 * problem.q.shape[1], dtype=bool))

    def run(self, axes: FloatArray, log: FloatArray | None = None,
            base_tilts: FloatArray | None = None) -> ArmState:
        """
        Return the minimum near a start.

        :param axes: (N, 3, 3). :param log: logarithms of gains (N,), 0 if not given.
        :param base_tilts: (L, 2) in rad, 0 if not given.
        """
        n, shares = len(axes), self.shares
        state = self._state(
            axes, np.zeros(n) if log is None else log,
            np.zeros((0 if shares is None else shares.shape[1], 2)) if base_tilts is None
            else base_tilts, self.problem.noise(self.problem.target))
        damping = _DAMPING
        for _ in range(_MAX_STEPS):
            columns = self._columns(state)
            if not len(columns):
                break
            better, damping = self._better(state, columns, damping)
            if better is None:
                break
            gain, state = state.cost - better.cost, better
            if gain < _CONVERGED:
                break
        return state

    def precision(self, state: ArmState) -> FloatArray:
        """Return the precision of the unknowns, then moments (2N,), for white residuals."""
        return self._gram(self._columns(state), state)[0]

    def _better(self, state: ArmState, columns: FloatArray, damping: float
                ) -> tuple[ArmState | None, float]:
        """Return the next state, or None where no step lowers the cost, and the damping."""
        (gram, rows), k = self._gram(columns, state), len(columns)
        vector = rows @ (state.residual / state.noise[:, None]).ravel()
        vector[k:] -= state.chain.moments.ravel() * self.problem.moment_std ** -2.0
        diagonal = gram.diagonal()[:k].copy()
        while damping < _HIGHEST:
            gram.flat[:k * len(gram):len(gram) + 1] = (1.0 + damping) * diagonal
            step = np.linalg.solve(gram, vector)[:k]
            share = min(1.0, _MAX_STEP / max(float(np.abs(step).max()), 1e-300))
            tried = self._moved(state, np.asarray(share * step))
            if tried.cost < state.cost:
                return tried, max(_SHRINK * damping, _LOWEST)
            damping *= _GROW
        return None, damping

    def _moved(self, state: ArmState, step: FloatArray) -> ArmState:
        n_axes, n_gains = int(self.axes.sum()), len(self.gains)
        tilts, log = np.zeros(len(self.axes)), state.log.copy()
        tilts[self.axes] = step[:n_axes]
        log[self.gains] += step[n_axes:n_axes + n_gains]
        return self._state(state.chain.axes @ tilt(tilts.reshape(-1, 2)), log,
                           state.base_tilts + step[n_axes + n_gains:].reshape(-1, 2), state.noise)

    def _state(self, axes: FloatArray, log: FloatArray, base_tilts: FloatArray,
               noise: FloatArray) -> ArmState:
        """Return the state with the best moments; `noise` (N,) is the first estimate."""
        problem, target, shares = self.problem, self.problem.target, self.shares
        arm = ForwardKinematics(axes, problem.q, problem.sin_cos,
                                None if shares is None else shares @ base_tilts)
        columns = problem.nuisance.whitened(arm.moment_columns() * np.exp(log)[:, None])
        by_joint = columns.swapaxes(0, 1)
        grams = by_joint @ by_joint.swapaxes(1, 2)
        vectors = (by_joint @ target[:, :, None])[:, :, 0]
        prior = problem.moment_std ** -2.0
        for _ in range(_NOISES):
            weights = noise ** -2.0
            gram = np.tensordot(weights, grams, axes=1)
            gram.flat[::len(gram) + 1] += prior + _ROUNDING * gram.diagonal().max()
            moments = np.linalg.solve(gram, weights @ vectors)
            residual = target - np.tensordot(moments, columns, axes=1)
            noise = problem.noise(residual)
        cost = float(len(problem.q) * np.log(noise).sum())
        chain = Chain(_orthogonal(axes), np.asarray(moments.reshape(-1, 2)))
        return ArmState(chain, log, base_tilts, residual, noise, cost, arm, columns)

    def _columns(self, state: ArmState) -> FloatArray:
        """Return whitened columns (K, N, M) of the unknowns, in N·m per unit."""
        moments, arm = state.chain.moments, state.arm
        n, m = state.residual.shape
        by_gain = np.zeros((len(self.gains), n, m))
        for k, joint in enumerate(self.gains):
            by_gain[k, joint] = arm.torque(moments)[:, joint]
        parts = [arm.axis_columns(moments)[self.axes], by_gain]
        if self.shares is not None:
            by_tilt = self.shares.T[:, None, None] * arm.base_columns(moments)
            parts.append(by_tilt.reshape(-1, n, m))
        return self.problem.nuisance.whitened(
            np.concatenate(parts) * np.exp(state.log)[:, None])

    def _gram(self, columns: FloatArray, state: ArmState) -> tuple[FloatArray, FloatArray]:
        """
        Return the products (P, P) of the columns, moments last, and the columns (P, N M).

        They are in units of the noise; the products contain the prior.
        """
        priors = self.problem.priors
        x = np.concatenate([columns, state.moment_columns]) / state.noise[:, None]
        rows = x.reshape(len(x), -1)
        n_axes, n_gains = int(self.axes.sum()), len(self.gains)
        std = np.full(len(x), priors.tilt)
        std[n_axes:n_axes + n_gains] = priors.gain
        std[len(columns):] = self.problem.moment_std
        gram = rows @ rows.T
        gram.flat[::len(gram) + 1] += std ** -2.0 + _ROUNDING * gram.diagonal().max()
        return np.asarray(gram), rows


def _orthogonal(axes: FloatArray) -> FloatArray:
    """Return the nearest rotations: products of many are no longer orthogonal after rounding."""
    u, _, vt = np.linalg.svd(axes)
    return np.asarray(u @ vt)


def search(problem: ArmProblem, starts: int, seed: int = 0) -> ArmState:
    """Return the best solution from at most a number of starts, drawn from `seed`."""
    best = min(_coarse_solutions(problem, starts, seed), key=cost_of)
    return ArmSolver.of_axes(problem).run(best.chain.axes)


def maxima(problem: ArmProblem, starts: int, seed: int = 0) -> list[ArmState]:
    """Return the best solution and those near it, the best one first."""
    solver = ArmSolver.of_axes(problem)
    return _near([solver.run(coarse.chain.axes)
                  for coarse in _near(_coarse_solutions(problem, starts, seed))])


def _coarse_solutions(problem: ArmProblem, starts: int, seed: int) -> list[ArmState]:
    """Return a solution of each start, until the best one was reached often enough."""
    few = ArmSolver.of_axes(_coarse(problem))
    rng, reached = np.random.default_rng(seed), 0
    best: ArmState | None = None
    found: list[ArmState] = []
    for count in range(1, starts + 1):
        tried = few.run(_next_axes(rng, problem.q.shape[1], count, best))
        found.append(tried)
        if best is not None and tried.cost > best.cost - _SAME:
            # A slightly lower cost is the same maximum again.
            reached += tried.cost < best.cost + _SAME
            if reached >= _HITS:
                break
            continue
        best, reached = tried, 0
    return found


def _near(states: list[ArmState]) -> list[ArmState]:
    """Return the state of least cost, and those near it whose gravity differs."""
    ordered = sorted(states, key=cost_of)
    q = random_poses(ordered[0].chain.n_joints)
    torques = [state.chain.torque(q) for state in ordered if state.cost < ordered[0].cost + _NEAR]
    allowed, kept = _ONE * np.sqrt((torques[0] ** 2).mean(axis=0)).max(), [0]
    for k in range(1, len(torques)):
        differences = torques[k] - np.stack([torques[other] for other in kept])
        if np.sqrt((differences ** 2).mean(axis=1)).max(axis=1).min() > allowed:
            kept.append(k)
    return [ordered[k] for k in kept]


def _next_axes(rng: np.random.Generator, n: int, count: int, best: ArmState | None) -> FloatArray:
    """Return random axes, or the best ones with one or two of them replaced."""
    random_axes = _random_axes(rng, n)
    if best is None or count <= _RANDOM or rng.random() < 0.25:
        return np.stack(list(random_axes))
    axes = best.chain.axes.copy()
    for j in rng.choice(n, size=min(n, int(rng.integers(1, 3))), replace=False):
        axes[j] = axes[j] @ next(random_axes)
    return axes


def _random_axes(rng: np.random.Generator, n: int) -> Iterator[FloatArray]:
    """Yield n rotations that take z to a random direction."""
    for direction in rng.normal(size=(n, 3)):
        yield aligned(direction / np.linalg.norm(direction))


def _coarse(problem: ArmProblem) -> ArmProblem:
    """
    Return the problem of at most `_COARSE_SAMPLES` evenly picked samples, with one noise.

    Far from a solution a joint with little effort would be fitted at the cost of all others.
    """
    few = problem.select(spread_over(len(problem.q), _COARSE_SAMPLES))
    return replace(few, has_one_noise=True)
