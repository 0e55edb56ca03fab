"""
Quick fit of one arm to the torques of a recording, with gains of efforts and tilts of its base.

    effort_n = exp(g_n) gravity_n(axes, moments, base) + friction, offset and inertia of joint n

The columns of friction, offset and inertia are projected out of each joint. Friction and offset
are of each recording: warm-up and zeroed sensors change them. The sum of the logarithms of the
joints' residuals is minimised, which does not depend on the units.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import evenly_picked, FloatArray, IntArray, JointSamples
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
from gravity_comp_ros.models.kinematic.chain_fit import rough_fit, SearchOptions
from gravity_comp_ros.models.kinematic.chain_solver import Nuisance
from gravity_comp_ros.models.noise import correlation_times, of_second_differences
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import generic_poses, INERTIA, later_recordings
import numpy as np

_SAMPLES, _ROWS, _STARTS, _STEPS = 20000, 400, 12, 40
# Widths of the direction of friction, rad/s.
WIDTHS = (0.003, 0.01, 0.04)
# Prior standard deviations per N·m of noise, as of a chain's start: offset, friction, inertia.
_SPREAD = np.array([3.0, *[30.0] * len(WIDTHS), 300.0, 30.0])
# Columns that differ between recordings: offset, friction of the middle width, viscous friction.
_CHANGING = np.array([0, 1 + len(WIDTHS) // 2, 1 + len(WIDTHS)])
# Rows of a recording, from which they are identified there.
_MIN_ROWS = 20
# Largest step of an axis or the base in rad, and of the logarithm of a gain.
_MAX_TILT, _MAX_GAIN = 0.3, 0.7
# Prior standard deviations of a tilt in rad (of described axes), of a moment in the largest, of
# the logarithm of a gain (per mille of a rated torque are a factor of 10 to 100), and of a tilt of
# the base in rad.
_TILT, _EXACT, _MOMENT, _GAIN, _BASE = 10.0, 1e-4, 60.0, 3.0, 0.5
_NONE = np.zeros(0, dtype=np.int64)
# Levenberg's damping: the first, its factors, and its limits.
_DAMPING, _FACTOR, _LOW_DAMPING, _HIGH_DAMPING = 1e-2, 5.0, 1e-7, 1e6
# Decrease of the cost in nats at which a search ends; floor of a residual as a share of effort.
_CONVERGED, _FLOOR = 0.3, 1e-4


@dataclass(frozen=True)
class ArmFitOptions:
    """
    Limits of another hypothesis about an arm.

    - `max_time`: correlation time of white residuals, in rows of some tenths of a second; that of
      a wrong hypothesis is that of the motion.
    - `min_gain`: log evidence in nats, over the autocorrelation time.

    :raises OptionError: if a value is not positive.
    """

    max_time: float = 10.0
    min_gain: float = 10.0

    def __post_init__(self) -> None:
        check_positive(self, 'arm fit')


@dataclass(frozen=True, eq=False)
class ArmState:
    """
    A chain, logarithms of gains (N,), `base_tilts` (K, 2) in rad, and the residual (M, N).

    The base at each pose has the sum of the tilts times their shares. The cost is in nats.
    """

    chain: Chain
    log: FloatArray
    base_tilts: FloatArray
    residual: FloatArray
    cost: float


def cost_of(state: ArmState) -> float:
    return state.cost


class ArmFit:
    """
    Levenberg-Marquardt on axes, moments, gains and tilts of the base.

    :param samples: in the order of the arm; some joints move, some efforts are not 0.
    :param rotations: of described axes (`Geometry`); None for unknown axes.
    """

    def __init__(self, samples: JointSamples, rotations: FloatArray | None = None,
                 options: ArmFitOptions = ArmFitOptions()) -> None:
        self.options = options
        problem = Problem.of(samples.select(evenly_picked(samples.n_samples, _SAMPLES)))
        self.poses, generic = generic_poses(problem, _ROWS)
        self.q, qd = self.poses.q, self.poses.qd
        columns = np.stack([np.ones(qd.shape), *(np.tanh(qd / w) for w in WIDTHS), qd,
                            generic.columns[:, INERTIA].T])
        changes = [rows[:, None] * columns[k]
                   for rows in later_recordings(self.poses.runs, _MIN_ROWS) for k in _CHANGING]
        self.nuisance = Nuisance(np.stack([*columns, *changes]).transpose(2, 0, 1),
                                 np.concatenate([_SPREAD, np.resize(_SPREAD[_CHANGING],
                                                                    len(changes))]))
        self.rotations = rotations
        self.bases = [_basis(columns) for columns in self.nuisance.columns]
        self.y = self.projected(self.poses.tau.T[None])[0]
        self.size = self.y.std(axis=1)
        self.floor = _FLOOR * np.maximum(self.size, 0.1 * self.size.max())

    @cached_property
    def plains(self) -> list[ArmState]:
        """Fits of equal gains and a base at rest, the best one first; a second one if needed."""
        fits = [self.run(self.start())]
        if self.rotations is None and not self.is_white(fits[0]):
            fits.append(self.run(self.start(1)))
        return sorted(fits, key=cost_of)

    @property
    def plain(self) -> ArmState:
        return self.plains[0]

    def start(self, seed: int = 0, log: FloatArray | None = None,
              rows: slice = slice(None)) -> Chain:
        """Return the chain of a search from random axes, for efforts of these gains."""
        n = self.q.shape[1]
        if self.rotations is not None:
            return Chain(self.rotations, np.zeros((n, 2)))
        keep = np.arange(len(self.q))[rows]
        poses = self.poses.select(keep)
        gains = np.exp(np.zeros(n) if log is None else -log)
        return rough_fit(replace(poses, tau=poses.tau * gains), self.nuisance.select(keep),
                         SearchOptions(_STARTS, seed)).chain

    def run(self, chain: Chain, log: FloatArray | None = None, free: IntArray = _NONE,
            shares: FloatArray | None = None, base_tilts: FloatArray | None = None) -> ArmState:
        """
        Return the minimum near a start.

        :param log: logarithms of gains (N,), 0 if not given.
        :param free: the joints with a free gain.
        :param shares: (M, K) of each tilt of the base at each pose.
        :param base_tilts: of the base at the start (K, 2), 0 if not given.
        """
        n = self.q.shape[1]
        shares = np.zeros((len(self.q), 0)) if shares is None else shares
        k = shares.shape[1]
        state = self._state(chain, np.zeros(n) if log is None else log, shares,
                            np.zeros((k, 2)) if base_tilts is None else base_tilts)
        damping = _DAMPING
        for _ in range(_STEPS):
            matrix, vector = self._normal(state, free, shares)
            while damping < _HIGH_DAMPING:
                step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), vector)
                tilts, moments, gains, base = np.split(
                    step, np.cumsum([2 * n, 2 * n, len(free)]))
                logs = state.log.copy()
                logs[free] += np.clip(gains, -_MAX_GAIN, _MAX_GAIN)
                tried = self._state(
                    state.chain.moved(np.concatenate(
                        [np.clip(tilts, -_MAX_TILT, _MAX_TILT), moments])), logs, shares,
                    state.base_tilts + np.clip(base.reshape(k, 2), -_MAX_TILT, _MAX_TILT))
                if tried.cost < state.cost:
                    break
                damping *= _FACTOR
            else:
                return state
            converged = state.cost - tried.cost < _CONVERGED
            state, damping = tried, max(damping / _FACTOR, _LOW_DAMPING)
            if converged:
                return state
        return state

    def std(self, state: ArmState, free: IntArray) -> FloatArray:
        """Return the standard deviations of the logarithms of free gains."""
        covariance = np.linalg.inv(self._normal(state, free, np.zeros((len(self.q), 0)))[0])
        return np.asarray(np.sqrt(self.time(state) * np.diag(covariance)[4 * self.q.shape[1]:]))

    def gains(self, chain: Chain) -> FloatArray:
        """Return the gains (N,) that each joint's effort has relative to a chain, 1 if unknown."""
        torque = self.projected(chain.torque(self.q).T[None])[0]
        square = (torque ** 2).sum(axis=1)
        gains = (torque * self.y).sum(axis=1) / np.maximum(square, 1e-300)
        known = (gains > 0.0) & (square > len(self.q) * self.floor ** 2)
        return np.asarray(np.where(known, gains, 1.0))

    def time(self, state: ArmState) -> float:
        """Return the longest correlation time of the joints' residuals, in rows."""
        return float(correlation_times(state.residual, self.poses.runs).max())

    def is_white(self, state: ArmState) -> bool:
        """Return whether the residuals are those of an arm: they do not follow the motion."""
        return self.time(state) <= self.options.max_time

    def is_better(self, state: ArmState, other: ArmState) -> bool:
        """Return whether a state is white, and clearly more probable than another one."""
        gain = (other.cost - state.cost) / self.time(state)
        return self.is_white(state) and gain >= self.options.min_gain

    def coloured(self, state: ArmState) -> float:
        """Return the largest residual beyond white noise, as a share of the largest effort."""
        white = of_second_differences(
            state.residual, self.poses.runs[2:] == self.poses.runs[:-2])
        square = (state.residual ** 2).mean(axis=0) - white ** 2
        return float(np.sqrt(max(square.max(), 0.0)) / self.size.max())

    def rest(self, state: ArmState) -> FloatArray:
        """Return the residual (N,) as a share of each joint's effort without friction."""
        return np.asarray(state.residual.std(axis=0) / np.maximum(self.size, 1e-300))

    def projected(self, x: FloatArray) -> FloatArray:
        """Return columns (P, N, M) without what the nuisance of each joint explains."""
        return np.stack([x[:, n] - (x[:, n] @ b) @ b.T for n, b in enumerate(self.bases)], axis=1)

    def _on_base(self, chain: Chain, shares: FloatArray, base_tilts: FloatArray
                 ) -> ForwardKinematics:
        moving = shares @ base_tilts if len(base_tilts) else None
        return ForwardKinematics(chain.axes, self.q, None, moving)

    def _state(self, chain: Chain, log: FloatArray, shares: FloatArray, base_tilts: FloatArray
               ) -> ArmState:
        torque = (self._on_base(chain, shares, base_tilts).torque(chain.moments) * np.exp(log)).T
        residual = (self.y - self.projected(torque[None])[0]).T
        noise = np.sqrt((residual ** 2).mean(axis=0) + self.floor ** 2)
        cost = float(len(residual) * np.log(noise).sum())
        return ArmState(chain, log, base_tilts, residual, cost)

    def _normal(self, state: ArmState, free: IntArray, shares: FloatArray
                ) -> tuple[FloatArray, FloatArray]:
        """Return the matrix (P, P) with the prior and the vector (P,) of the normal equations."""
        n, m = self.q.shape[1], len(self.q)
        gain, moments = np.exp(state.log), state.chain.moments
        arm = self._on_base(state.chain, shares, state.base_tilts)
        by_gain = np.zeros((len(free), n, m))
        for k, joint in enumerate(free):
            by_gain[k, joint] = arm.torque(moments)[:, joint]
        by_tilt = shares.T[:, None, None] * arm.base_columns(moments)
        x = self.projected(np.concatenate([
            arm.axis_columns(moments), arm.moment_columns(), by_gain,
            by_tilt.reshape(-1, n, m)]) * gain[None, :, None])
        noise = np.sqrt((state.residual ** 2).mean(axis=0) + self.floor ** 2)
        x = (x / noise[None, :, None]).reshape(len(x), -1)
        largest = max(float(np.abs(moments).max()), float(self.size.max()))
        std = np.concatenate([np.full(2 * n, _TILT if self.rotations is None else _EXACT),
                              np.full(2 * n, _MOMENT * largest),
                              np.full(len(free), _GAIN), np.full(state.base_tilts.size, _BASE)])
        prior = np.diag(std ** -2.0)
        return x @ x.T + prior, x @ (state.residual / noise).T.ravel()


def moves_enough(samples: JointSamples) -> bool:
    """Return whether there are samples, efforts and joints that move, for an `ArmFit`."""
    limits = FactOptions()
    return (len(samples) >= limits.min_samples
            and (np.ptp(samples.q, axis=0) > limits.wide_travel).sum() >= 2
            and float(np.abs(samples.tau).max()) > limits.dead_torque)


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis (M, K) of columns (C, M)."""
    length = np.maximum(np.linalg.norm(columns, axis=1), 1e-12)
    u, s, _ = np.linalg.svd((columns / length[:, None]).T, full_matrices=False)
    return np.asarray(u[:, s > 1e-8])
