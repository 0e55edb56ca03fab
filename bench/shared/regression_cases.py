"""Small regressions whose answer is known: noise, a pendulum, and two links in a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.shared.serial_arms import planar_2r
from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.effects.registry import known_effect
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.regression.candidates import TermFactory
from gravity_comp_ros.regression.design import Design
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.prior import Prior, Scale
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.shared import Shared, State
from gravity_comp_ros.regression.term import Term
import numpy as np

NOISE = 0.05
# Effects that the small tests select from.
EFFECTS = ('coulomb_friction', 'viscous_friction', 'torque_offset', 'joint_spring',
           'torque_drift')


@dataclass(frozen=True, eq=False)
class OwnGravity(Shared):
    """Gravity of joints that do not load each other: s_n sin q_n + c_n cos q_n, in N·m."""

    weights: FloatArray

    @property
    def point(self) -> FloatArray:
        return self.weights

    def prior(self, scale: Scale) -> Prior:
        k = len(self.weights)
        return Prior(np.zeros(k), 3.0 * scale.largest * (np.eye(k) + np.tri(k, k, -1)))

    def columns(self, state: State) -> FloatArray:
        n = state.q.shape[1]
        columns = np.zeros((*state.q.shape, 2 * n))
        for joint in range(n):
            q = state.q[:, joint]
            columns[:, joint, 2 * joint:2 * joint + 2] = np.column_stack([np.sin(q), np.cos(q)])
        return columns

    def gravity(self, q: FloatArray) -> FloatArray:
        return np.sin(q) * self.weights[::2] + np.cos(q) * self.weights[1::2]

    def moved(self, parameters: FloatArray) -> OwnGravity:
        return OwnGravity(parameters)


def motion_of_joints(n_joints: int, seed: int, seconds: float = 60.0, rate: float = 20.0,
                     runs: int = 2) -> list[JointSamples]:
    """Return runs of sums of three sines on each joint, without torque."""
    rng, t, parts = np.random.default_rng(seed), np.arange(0.0, seconds, 1.0 / rate), []
    for _ in range(runs):
        w, phase = rng.uniform(0.1, 0.5, (3, n_joints)), rng.uniform(0, 6, (3, n_joints))
        angle = w * t[:, None, None] + phase
        q, qd = 0.5 * np.sin(angle).sum(axis=1), 0.5 * (w * np.cos(angle)).sum(axis=1)
        parts.append(JointSamples.single_run(tuple(f'j{k}' for k in range(n_joints)), t, q, qd,
                                             0.0 * q))
    return parts


def with_torque(parts: Sequence[JointSamples], torque, seed: int = 0,
                noise: float = NOISE) -> JointSamples:
    """Return the runs with the torque of a function of q, qd and t, and white noise."""
    rng = np.random.default_rng(seed)
    return concatenate([JointSamples.single_run(
        p.names, p.t, p.q, p.qd,
        torque(p.q, p.qd, p.t) + noise * rng.standard_normal(p.q.shape), f'run {k}')
        for k, p in enumerate(parts)])


def linear_problem(samples: JointSamples, shared: Shared,
                   options: EngineOptions = EngineOptions()
                   ) -> tuple[Problem, Design, TermFactory]:
    """Return a problem with its design at the shared part, and a factory of terms."""
    problem = Problem.of(samples, options=options)
    motion = problem.motion.with_gravity(shared.gravity(samples.q), shared.gradient)
    columns = problem.states.mean(shared.columns)
    weights = np.repeat(problem.rows.weights[:, None], samples.n_joints, axis=1)
    design = Design(problem.rows, problem.y, columns, shared.prior(problem.scale), weights)
    return problem, design, TermFactory(lambda: motion, problem.rows, problem.scale)


def first_terms(factory: TermFactory, joint: int, names: Sequence[str] = EFFECTS) -> list[Term]:
    """Return a term of each effect on a joint, at its first setting."""
    terms = []
    for name in names:
        effect = known_effect(name)
        setting = effect.settings(factory.motion, joint)[0]
        terms.append(factory.term(effect, joint, setting))
    return terms


def two_links(seed: int, torque=lambda q, qd, t: 0.0 * q, noise: float = NOISE) -> JointSamples:
    """Return two runs of two links in a vertical plane, with another torque added."""
    return with_torque(motion_of_joints(2, seed),
                       lambda q, qd, t: planar_2r(q) + torque(q, qd, t), seed, noise)


def chain_of_two_links() -> Chain:
    """Return the axes and moments of `two_links`, turned by a few degrees."""
    turned = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    exact = Chain(np.array([turned, np.eye(3)]),
                  9.81 * np.array([[3.0 * 0.25 + 2.0 * 0.5, 0.0], [2.0 * 0.2, 0.0]]))
    return exact.moved(np.array([0.05, -0.03, 0.04, 0.06, 0.5, -0.4, 0.3, 0.2]))
