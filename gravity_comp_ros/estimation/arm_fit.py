"""
Fits of one arm to the efforts of a recording, with gains and tilts of its base (`arm_solver`).

Friction, offset and inertia of each joint are nuisance columns. Friction and offset are of each
recording: warm-up and zeroed sensors change them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from gravity_comp_ros.data.samples import evenly_picked, FloatArray, IntArray, JointSamples
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.kinematic.arm_solver import ArmSolver, ArmState, cost_of, search
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.noise import of_second_differences
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import arm_problem, generic_poses
import numpy as np

_SAMPLES, _ROWS = 20000, 400
# Number of starts of a search, and of one whose result is to be refuted.
_STARTS, MANY = 12, 72
_NONE = np.zeros(0, dtype=np.int64)


class ArmFit:
    """
    Fits of axes, moments, gains and tilts of the base, to compare hypotheses about an arm.

    :param samples: in the order of the arm; some joints move, some efforts are not 0.
    :param rotations: of described axes (`Geometry`); None for unknown axes.
    """

    def __init__(self, samples: JointSamples, rotations: FloatArray | None = None) -> None:
        self.rotations = rotations
        self.regression = Problem.of(samples.select(evenly_picked(samples.n_samples, _SAMPLES)))
        self.poses, nuisance = generic_poses(self.regression, _ROWS)
        self.problem = arm_problem(self.poses, nuisance)
        self.q, self.y = self.problem.q, self.problem.target
        self.size = self.y.std(axis=1)

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
              rows: slice = slice(None), starts: int = _STARTS) -> FloatArray:
        """Return the axes (N, 3, 3) of a search from random ones, for efforts of these gains."""
        if self.rotations is not None:
            return self.rotations
        problem = self.problem.select(np.arange(len(self.q))[rows])
        gains = np.exp(np.zeros(self.q.shape[1]) if log is None else -log)
        scaled = replace(problem, tau=problem.tau * gains, floor=problem.floor * gains)
        return search(scaled, starts, seed).chain.axes

    def run(self, axes: FloatArray, log: FloatArray | None = None, free: IntArray = _NONE,
            shares: FloatArray | None = None, base_tilts: FloatArray | None = None) -> ArmState:
        """
        Return the minimum near a start (`ArmSolver.run`).

        :param free: the joints with a free gain.
        :param shares: (M, L) of each tilt of the base at each pose.
        """
        return self._solver(free, shares).run(axes, log, base_tilts)

    def std(self, state: ArmState, free: IntArray) -> FloatArray:
        """Return the standard deviations of the logarithms of free gains."""
        solver = self._solver(free, None)
        covariance = np.linalg.inv(solver.precision(state))
        first = int(solver.axes.sum())
        variance = np.diag(covariance)[first:first + len(free)]
        return np.asarray(np.sqrt(self.time(state) * variance))

    def gains(self, chain: Chain) -> FloatArray:
        """Return the gains (N,) that each joint's effort has relative to a chain, 1 if unknown."""
        torque = self.whitened(chain.torque(self.q).T[None])[0]
        square = (torque ** 2).sum(axis=1)
        gains = (torque * self.y).sum(axis=1) / np.maximum(square, 1e-300)
        known = (gains > 0.0) & (square > len(self.q) * self.problem.floor ** 2)
        return np.asarray(np.where(known, gains, 1.0))

    def time(self, state: ArmState) -> float:
        """Return the longest correlation time of the joints' residuals, in rows."""
        return float(state.times(self.poses.runs).max())

    def is_white(self, state: ArmState) -> bool:
        """Return whether the residuals are those of an arm: they do not follow the motion."""
        return self.time(state) <= OPTIONS.max_time

    def is_better(self, state: ArmState, other: ArmState) -> bool:
        """Return whether a state is white, and clearly more probable than another one."""
        gain = (other.cost - state.cost) / self.time(state)
        return self.is_white(state) and gain >= OPTIONS.min_gain

    def coloured(self, state: ArmState) -> float:
        """Return the largest residual beyond white noise, as a share of the largest effort."""
        white = of_second_differences(
            state.residual.T, self.poses.runs[2:] == self.poses.runs[:-2])
        square = (state.residual ** 2).mean(axis=1) - white ** 2
        return float(np.sqrt(max(square.max(), 0.0)) / self.size.max())

    def rest(self, state: ArmState) -> FloatArray:
        """Return the residual (N,) as a share of each joint's effort without friction."""
        return np.asarray(state.residual.std(axis=1) / np.maximum(self.size, 1e-300))

    def whitened(self, x: FloatArray) -> FloatArray:
        """Return columns (P, N, M) without what the nuisance of each joint explains."""
        return self.problem.nuisance.whitened(x)

    def _solver(self, free: IntArray, shares: FloatArray | None) -> ArmSolver:
        axes = np.full(2 * self.q.shape[1], self.rotations is None)
        return ArmSolver(self.problem, axes, free, shares)


def moves_enough(samples: JointSamples) -> bool:
    """Return whether there are samples, efforts and joints that move, for an `ArmFit`."""
    limits = FactOptions()
    return (len(samples) >= limits.min_samples
            and (np.ptp(samples.q, axis=0) > limits.wide_travel).sum() >= 2
            and float(np.abs(samples.tau).max()) > limits.dead_torque)
