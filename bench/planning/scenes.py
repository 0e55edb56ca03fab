"""Poor recordings of arms with one hidden effect, and three ways to go on from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.data.trajectory import Trajectory
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.planning import PlanOptions
from gravity_comp_ros.simulation import motions
from gravity_comp_ros.simulation.arms import Arm, iiwa7
from gravity_comp_ros.simulation.hidden import hidden
from gravity_comp_ros.simulation.noise import NoiseOptions
from gravity_comp_ros.simulation.six_axis import six_axis
from gravity_comp_ros.simulation.synthesise import synthesise, SynthesisOptions
import numpy as np

ARMS: dict[str, Callable[[], Arm]] = {'iiwa7': iiwa7, 'six_axis': six_axis}
POOR = ('one_way', 'narrow', 'one_speed', 'one_posture')
# Effect and size on the joint under test, in the simulation's own laws.
EFFECTS = {'coulomb_friction': 1.0, 'viscous_friction': 8.0, 'torque_offset': 1.5}
RATE, POOR_SECONDS, MORE_SECONDS = 25.0, 60.0, 20.0
_NOISE = 0.1


@dataclass(frozen=True)
class Scene:
    """An arm, what is hidden on joint number `joint` (from 0), and what its recording lacks."""

    arm: str
    effect: str
    joint: int
    poor: str
    seed: int

    @property
    def name(self) -> str:
        return f'{self.arm}-{self.effect}-{self.joint + 1}-{self.poor}-{self.seed}'

    def recorded(self, motion: motions.Motion, again: int) -> JointSamples:
        """Return what the arm records on a motion."""
        arm = ARMS[self.arm]()
        what = hidden(f'{self.effect}:{self.joint + 1}={EFFECTS[self.effect]}', arm).disturbance
        options = SynthesisOptions(NoiseOptions(0.0, _NOISE), 100 * self.seed + again,
                                   disturbances=(what,))
        return synthesise(arm, motion, options)

    def poor_motion(self) -> motions.Motion:
        """Return 60 s of motion that lacks something on the joint under test."""
        arm, rng = ARMS[self.arm](), np.random.default_rng(self.seed)
        middle = rng.uniform(-0.5, 0.5, arm.n_joints)
        reach = 0.15 if self.poor == 'narrow' else 0.7
        base = motions.multisine(middle - reach, middle + reach, arm.max_speed, self.seed,
                                 motions.MultisineOptions(0.12, POOR_SECONDS), POOR_SECONDS, RATE)

        def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            q, qd, qdd = (x.copy() for x in base.path(t))
            if self.poor == 'one_posture':
                others = np.arange(arm.n_joints) != self.joint
                q[:, others], qd[:, others], qdd[:, others] = middle[others], 0.0, 0.0
            if self.poor in ('one_way', 'one_speed'):
                way = _one_way if self.poor == 'one_way' else _one_speed
                for values, mine in zip((q, qd, qdd), way(t)):
                    values[:, self.joint] = mine
                q[:, self.joint] += middle[self.joint]
            return q, qd, qdd

        return motions.sample(self.poor, path, POOR_SECONDS, RATE)


def played(trajectory: Trajectory) -> motions.Motion:
    """Return a planned motion as the arm plays it."""
    return motions.sample('planned', trajectory.at, trajectory.duration, RATE)


def random_slow(samples: JointSamples, options: PlanOptions, seed: int) -> motions.Motion:
    """Return slow random motion of all joints within the recorded range, as fast as a plan."""
    low, high = samples.q.min(axis=0), samples.q.max(axis=0)
    limit = np.full(samples.n_joints, options.max_speed)
    sines = motions.MultisineOptions(options.max_speed, MORE_SECONDS, 0.25, 5, 2.0)
    return motions.multisine(low - 1e-3, high + 1e-3, limit, seed, sines, MORE_SECONDS, RATE)


def fourier(samples: JointSamples, model: GravityModel, options: PlanOptions,
            seed: int) -> motions.Motion:
    """Return the best of 30 random Fourier series by D-optimality of all parameters alike."""
    best, best_value = None, -np.inf
    for draw in range(30):
        motion = random_slow(samples, options, 1000 + 100 * seed + draw)
        value = sum(_log_det(model, motion, n) for n in range(samples.n_joints))
        if value > best_value:
            best, best_value = motion, value
    if best is None:
        raise RuntimeError('no Fourier series was drawn')
    return best


def _log_det(model: GravityModel, motion: motions.Motion, joint: int) -> float:
    gravity = (model.chain.jacobian(motion.q)[:, joint].T if model.chain is not None
               else model.predict(motion.q)[:, [joint]])
    qd = motion.qd[:, joint]
    rows = np.column_stack([gravity, np.tanh(qd / 0.005), qd, np.ones(len(qd)),
                            motion.qdd[:, joint]])
    return float(np.linalg.slogdet(rows.T @ rows + 1e-3 * np.eye(rows.shape[1]))[1])


def _one_way(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a turn of 1.2 rad, now faster, now slower, never back."""
    w, span = 2 * np.pi * 4 / POOR_SECONDS, 1.2 / POOR_SECONDS
    return (span * (t + 0.7 * np.sin(w * t) / w) - 0.6, span * (1 + 0.7 * np.cos(w * t)),
            -0.7 * span * w * np.sin(w * t))


def _one_speed(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a turn to and fro at 0.1 rad/s; it turns back within 0.4 s."""
    period, speed, turn = 16.0, 0.1, 0.4
    x = np.mod(t, period)
    edge = np.minimum(np.minimum(x, np.abs(x - period / 2)), period - x)
    sign = np.where(x < period / 2, 1.0, -1.0)
    share = np.clip(edge / turn, 0.0, 1.0)
    qd = sign * speed * share * share * (3 - 2 * share)
    slope = np.where(edge < turn, np.where(np.mod(x, period / 2) < period / 4, 1.0, -1.0), 0.0)
    qdd = sign * speed * 6 * share * (1 - share) * slope / turn
    fine = np.linspace(0.0, POOR_SECONDS + 1.0, 20001)
    return np.interp(t, fine, _integral(fine, period, speed, turn)), qd, qdd


def _integral(t: FloatArray, period: float, speed: float, turn: float) -> FloatArray:
    x = np.mod(t, period)
    edge = np.minimum(np.minimum(x, np.abs(x - period / 2)), period - x)
    share = np.clip(edge / turn, 0.0, 1.0)
    qd = np.where(x < period / 2, 1.0, -1.0) * speed * share * share * (3 - 2 * share)
    return np.concatenate([[0.0], np.cumsum(0.5 * (qd[1:] + qd[:-1]) * np.diff(t))]) - 0.4
