"""
Gains of the joints' efforts that contradict one arm: other units, rated torques, gear ratios.

The torques of all joints come from the same moments, seen through the axes (`Chain`). With a gain
of each joint,

    effort_n = exp(g_n) gravity_n(axes, moments) + friction, offset and inertia of joint n,

the differences of the g_n are identified where two joints carry the same link at several poses;
their common part is a unit of the moments. A joint without gravity of its own, such as the first
of a level arm, has no identified gain. The sum of the logarithms of the joints' residuals is
minimised, which does not depend on the units, from several gains at the start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import evenly_picked, FloatArray, IntArray, JointSamples
from gravity_comp_ros.facts.fact import Action, Fact, Kind
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import rough_fit
from gravity_comp_ros.models.kinematic.chain_starts import SearchOptions
from gravity_comp_ros.models.kinematic.nuisance import Nuisance
from gravity_comp_ros.models.noise import correlation_times
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import generic_poses
import numpy as np

_SAMPLES, _ROWS, _STARTS, _STEPS = 20000, 400, 12, 40
# Widths of the direction of friction, rad/s.
_WIDTHS = (0.003, 0.01, 0.04)
# Prior standard deviations per N·m of noise, as of a chain's start: offset, friction, inertia.
_SPREAD = np.array([3.0, *[30.0] * len(_WIDTHS), 300.0, 30.0])
# Largest step of an axis in rad, and of the logarithm of a gain.
_MAX_TILT, _MAX_GAIN = 0.3, 0.7
# Prior standard deviations of a tilt in rad (of described axes) and of a moment in the largest.
_TILT, _EXACT, _MOMENT = 10.0, 1e-4, 60.0
# Levenberg's damping: the first, its factors, and its limits.
_DAMPING, _FACTOR, _LOW_DAMPING, _HIGH_DAMPING = 1e-2, 5.0, 1e-7, 1e6
# Decrease of the cost in nats at which a search ends; floor of a residual as a share of effort.
_CONVERGED, _FLOOR = 0.3, 1e-4


@dataclass(frozen=True)
class GainOptions:
    """
    Limits of gains that disagree.

    - `min_ratio`: smaller differences are the effect `torque_gain`; other units and ratings differ
      by more.
    - `sigmas`: standard deviations by which the logarithm of a gain differs from 0.
    - `max_residual`: share of a joint's effort (without friction) that an arm with these gains
      may leave, and `max_reference` of the joint with the largest effort; more is another effect.
    - `max_time`: correlation time of the residuals, in rows of some tenths of a second; that of
      an arm with wrong gains, or of a base that moved, is that of the motion.
    - `min_gain`: log evidence in nats, over the autocorrelation time, of gains that differ.
    - `prior`: prior standard deviation of the logarithm of a gain: per mille of a rated torque are
      a factor of 10 to 100.
    - `starts`: gains at the start of the search: equal ones, then drawn ones.

    :raises OptionError: if a value is not positive.
    """

    min_ratio: float = 1.5
    sigmas: float = 4.0
    max_residual: float = 0.3
    max_reference: float = 0.1
    max_time: float = 10.0
    min_gain: float = 10.0
    prior: float = 3.0
    starts: int = 4

    def __post_init__(self) -> None:
        check_positive(self, 'gains')


@dataclass(frozen=True)
class JointGains:
    """
    Gains relative to the joint `reference`.

    `log` and `std` (N,) are the logarithm and its standard deviation, `residual` (N,) the share of
    a joint's effort that remains, `time` its correlation time in rows, `evidence` in nats that of
    gains that differ.
    """

    names: tuple[str, ...]
    reference: int
    log: FloatArray
    std: FloatArray
    residual: FloatArray
    time: float
    evidence: float

    def relative_to(self, model: GravityModel, samples: JointSamples) -> JointGains:
        """Return the gains relative to the joint whose effort is most like that of a model."""
        gravity, change = model.predict(samples.q), np.full(len(self.names), np.inf)
        for n in np.flatnonzero(self.std < np.log(GainOptions().min_ratio)):
            columns = np.column_stack([gravity[:, n], np.ones(len(gravity)), samples.qd[:, n],
                                       np.tanh(samples.qd[:, n] / _WIDTHS[1])])
            gain = float(np.linalg.lstsq(columns, samples.tau[:, n], rcond=None)[0][0])
            change[n] = abs(np.log(max(gain, 1e-9)))
        best = int(np.argmin(change))
        std = np.hypot(self.std, self.std[best])
        std[best] = 0.0
        return replace(self, reference=best, log=self.log - self.log[best], std=std)

    def facts(self, options: GainOptions = GainOptions()) -> list[Fact]:
        """Return the fact that gains disagree, if they do."""
        if self.evidence < options.min_gain or self.time > options.max_time:
            return []
        clear = ((np.abs(self.log) > np.log(options.min_ratio))
                 & (np.abs(self.log) > options.sigmas * self.std)
                 & (self.residual < options.max_residual))
        if not clear.any() or self.residual[self.reference] > options.max_reference:
            return []
        joints = [int(n) for n in np.flatnonzero(clear)]
        parts = [f'{self.names[n]} {self._ratio(n)}' for n in joints]
        ratios = {self.names[n]: float(np.exp(self.log[n])) for n in joints}
        scales = ','.join(f'{name}={1.0 / ratio:.3g}' for name, ratio in ratios.items())
        agree = [name for n, name in enumerate(self.names) if n != self.reference
                 and n not in joints and options.sigmas * self.std[n] < np.log(options.min_ratio)]
        also = f'; in agreement: {", ".join(agree)}' if agree else ''
        return [Fact(
            Kind.EFFORT_GAIN, tuple(ratios), f'gains disagree: effort in multiples of what '
            f'{self.names[self.reference]} implies by the links that both carry is '
            f'{", ".join(parts)}{also}', Action.NOTED, 'no arm has such torques: units, rated '
            'torques, gear ratios or torque constants differ',
            f'--effort-scale {scales} gives them the unit of {self.names[self.reference]}',
            ratios)]

    def _ratio(self, n: int) -> str:
        low, ratio, high = np.exp(self.log[n] + self.std[n] * np.array([-1.96, 0.0, 1.96]))
        return f'{ratio:.3g} (95 %: {low:.3g} to {high:.3g})'


def joint_gains(samples: JointSamples, rotations: FloatArray | None = None,
                options: GainOptions = GainOptions()) -> JointGains | None:
    """
    Return the gains of a recording, None if too little moves.

    :param samples: in the order of the arm.
    :param rotations: of described axes (`Geometry`); None for unknown axes.
    """
    limits, n = FactOptions(), samples.n_joints
    wide = np.ptp(samples.q, axis=0) > limits.wide_travel if len(samples) else np.zeros(n)
    if len(samples) < limits.min_samples or wide.sum() < 2 or not samples.tau.any():
        return None
    problem = Problem.of(samples.select(evenly_picked(samples.n_samples, _SAMPLES)))
    poses, generic = generic_poses(problem, _ROWS)
    columns = np.stack([np.ones(poses.q.shape), *(np.tanh(poses.qd / w) for w in _WIDTHS),
                        poses.qd, generic.columns[:, -1].T])
    nuisance = Nuisance(columns.transpose(2, 0, 1), _SPREAD)
    fit = _Fit(poses, nuisance, rotations is not None, options)
    reference = int(np.argmax(fit.size))
    free = np.array([k for k in range(n) if k != reference and fit.size[k] > 0])
    rng, none = np.random.default_rng(0), np.zeros(n)

    def start(log: FloatArray, seed: int) -> Chain:
        if rotations is not None:
            return Chain(rotations, np.zeros((n, 2)))
        return rough_fit(replace(poses, tau=poses.tau * np.exp(-log)), nuisance,
                         SearchOptions(_STARTS, seed)).chain

    first = [start(none, seed) for seed in range(1 if rotations is not None else 2)]
    equal = min((fit.run(chain, none, free[:0]) for chain in first), key=_cost)
    fits = [fit.run(equal.chain, none, free)]
    time = _correlation_time(fits[0])
    if time > options.max_time or equal.cost - fits[0].cost > options.min_gain * time:
        for seed in range(1, options.starts):
            log = np.zeros(n)
            log[free] = rng.normal(0.0, 0.4 * options.prior, len(free))
            fits.append(fit.run(start(log, seed), log, free))
    best = min(fits, key=_cost)
    time = _correlation_time(best)
    std = np.zeros(n)
    std[free] = np.sqrt(time) * fit.std(best, free)
    rest = best.residual.std(axis=0) / np.maximum(fit.size, 1e-300)
    return JointGains(samples.names, reference, best.log, std, rest, time,
                      (equal.cost - best.cost) / time)


@dataclass(frozen=True, eq=False)
class _State:
    """A chain, logarithms of gains (N,), residual (M, N), and the cost in nats."""

    chain: Chain
    log: FloatArray
    residual: FloatArray
    cost: float


def _cost(state: _State) -> float:
    return state.cost


def _correlation_time(state: _State) -> float:
    """Return the longest correlation time of the joints' residuals, in rows."""
    runs = np.zeros(len(state.residual), dtype=np.int64)
    return float(correlation_times(state.residual, runs).max())


class _Fit:
    """Levenberg-Marquardt on axes, moments and gains; nuisance columns are projected out."""

    def __init__(self, poses: JointSamples, nuisance: Nuisance, known: bool,
                 options: GainOptions) -> None:
        self.q, self.known, self.options = poses.q, known, options
        self.bases = [_basis(columns) for columns in nuisance.columns]
        self.y = self._projected(poses.tau.T[None])[0]
        self.size = self.y.std(axis=1)
        self.floor = _FLOOR * np.maximum(self.size, 0.1 * self.size.max())

    def _projected(self, x: FloatArray) -> FloatArray:
        """Return columns (P, N, M) without what the nuisance of each joint explains."""
        return np.stack([x[:, n] - (x[:, n] @ b) @ b.T for n, b in enumerate(self.bases)], axis=1)

    def _state(self, chain: Chain, log: FloatArray) -> _State:
        torque = (chain.torque(self.q) * np.exp(log)).T
        residual = (self.y - self._projected(torque[None])[0]).T
        noise = np.sqrt((residual ** 2).mean(axis=0) + self.floor ** 2)
        return _State(chain, log, residual, float(len(residual) * np.log(noise).sum()))

    def _normal(self, state: _State, free: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the matrix (P, P) with the prior and the vector (P,) of the normal equations."""
        n, m = self.q.shape[1], len(self.q)
        gain = np.exp(state.log)
        by_gain = np.zeros((len(free), n, m))
        for k, joint in enumerate(free):
            by_gain[k, joint] = state.chain.torque(self.q)[:, joint] * gain[joint]
        x = self._projected(np.concatenate([
            state.chain.jacobian(self.q) * gain[None, :, None], by_gain]))
        noise = np.sqrt((state.residual ** 2).mean(axis=0) + self.floor ** 2)
        x = (x / noise[None, :, None]).reshape(len(x), -1)
        largest = max(float(np.abs(state.chain.moments).max()), float(self.size.max()))
        std = np.concatenate([np.full(2 * n, _EXACT if self.known else _TILT),
                              np.full(2 * n, _MOMENT * largest),
                              np.full(len(free), self.options.prior)])
        prior = np.diag(std ** -2.0)
        return x @ x.T + prior, x @ (state.residual / noise).T.ravel()

    def run(self, chain: Chain, log: FloatArray, free: IntArray) -> _State:
        """Return the minimum near a start; `free` are the joints with a free gain."""
        state, damping, n = self._state(chain, log), _DAMPING, self.q.shape[1]
        for _ in range(_STEPS):
            matrix, vector = self._normal(state, free)
            while damping < _HIGH_DAMPING:
                step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), vector)
                tilts = np.clip(step[:2 * n], -_MAX_TILT, _MAX_TILT)
                gains = state.log.copy()
                gains[free] += np.clip(step[4 * n:], -_MAX_GAIN, _MAX_GAIN)
                tried = self._state(state.chain.moved(np.concatenate(
                    [tilts, step[2 * n:4 * n]])), gains)
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

    def std(self, state: _State, free: IntArray) -> FloatArray:
        """Return the standard deviations of the logarithms of free gains."""
        covariance = np.linalg.inv(self._normal(state, free)[0])
        return np.asarray(np.sqrt(np.diag(covariance)[4 * self.q.shape[1]:]))


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis (M, K) of columns (C, M)."""
    length = np.maximum(np.linalg.norm(columns, axis=1), 1e-12)
    u, s, _ = np.linalg.svd((columns / length[:, None]).T, full_matrices=False)
    return np.asarray(u[:, s > 1e-8])
