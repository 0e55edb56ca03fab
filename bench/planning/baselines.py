"""Baseline motions that a plan is compared with: slow random motion, and Fourier series."""

from __future__ import annotations

from bench.planning.poor import RATE
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.planning import PlanOptions
from gravity_comp_ros.simulation import motions
import numpy as np

# Duration of the additional motion, s; number of Fourier series drawn.
MORE_SECONDS = 20.0


def played(trajectory: Trajectory) -> motions.Motion:
    """Return a trajectory as a motion of the simulated arm."""
    return motions.sample('planned', trajectory.at, trajectory.duration, RATE)


def random_slow(samples: JointSamples, options: PlanOptions, seed: int) -> motions.Motion:
    """Return slow random motion of all joints within the recorded range, at a plan's speed."""
    low, high = samples.q.min(axis=0), samples.q.max(axis=0)
    return random_wide(options, low - 1e-3, high + 1e-3, seed)


def random_wide(options: PlanOptions, low: FloatArray, high: FloatArray, seed: int
                ) -> motions.Motion:
    """Return slow random motion of all joints within position limits (N,)."""
    return slow_sines(low, high, options.max_speed, seed)


def slow_sines(low: FloatArray, high: FloatArray, speed: float, seed: int) -> motions.Motion:
    """Return random sines of all joints between position limits (N,), up to `speed` rad/s."""
    sines = motions.MultisineOptions(speed, MORE_SECONDS, 0.25, 5, 2.0)
    return motions.multisine(low, high, np.full(len(low), speed), seed, sines, MORE_SECONDS, RATE)
