"""Baseline motions that a plan is compared with: slow random motion, and Fourier series."""

from __future__ import annotations

from bench.planning.poor import RATE
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning import PlanOptions
from gravity_comp_ros.planning.workspace import workspace
from gravity_comp_ros.simulation import motions
import numpy as np

# Duration of the additional motion, s; number of Fourier series drawn.
MORE_SECONDS = 20.0
_DRAWS = 30


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


def random_near(samples: JointSamples, options: PlanOptions, joint: int,
                seed: int) -> motions.Motion:
    """
    Return slow random motion of a joint and its neighbours, within reach of recorded poses.

    It starts at the start pose of a plan, and is as wide as the limits admit.
    """
    space, free = workspace(samples, options), random_slow(samples, options, seed)
    moving = np.abs(np.arange(samples.n_joints) - joint) <= 1
    start, middle = space.start, 0.5 * (free.q.min(axis=0) + free.q.max(axis=0))
    size = next((s for s in np.linspace(1.0, 0.05, 20)
                 if space.admits(start + s * moving * (free.q - middle))), 0.0)

    def path(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q, qd, qdd = free.path(t)
        return start + size * moving * (q - middle), size * moving * qd, size * moving * qdd

    return motions.sample('random near', path, MORE_SECONDS, RATE)


def fourier(samples: JointSamples, model: GravityModel, options: PlanOptions,
            seed: int) -> motions.Motion:
    """Return the best of 30 random Fourier series by D-optimality of all parameters."""
    drawn = [random_slow(samples, options, 1000 + 100 * seed + draw) for draw in range(_DRAWS)]
    return max(drawn, key=lambda motion: sum(_log_det(model, motion, n)
                                             for n in range(samples.n_joints)))


def _log_det(model: GravityModel, motion: motions.Motion, joint: int) -> float:
    gravity = (model.chain.jacobian(motion.q)[:, joint].T if model.chain is not None
               else model.predict(motion.q)[:, [joint]])
    qd = motion.qd[:, joint]
    rows = np.column_stack([gravity, np.tanh(qd / 0.005), qd, np.ones(len(qd)),
                            motion.qdd[:, joint]])
    return float(np.linalg.slogdet(rows.T @ rows + 1e-3 * np.eye(rows.shape[1]))[1])
