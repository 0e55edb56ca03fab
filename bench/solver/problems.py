"""L1 problems of simulated arms, with rows in units of the noise."""

from __future__ import annotations

from dataclasses import dataclass

from bench.cases.arms import generated_arm
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.synthesise import NoiseOptions, synthesise, SynthesisOptions
import numpy as np


@dataclass(frozen=True)
class Problem:
    """
    One joint's torque over the dictionary of all joints.

    minimise 1/2 |A x - b|^2 + lam |x|_1, with A the weighted features at unit length.
    """

    q: np.ndarray
    weights: np.ndarray
    b: np.ndarray
    lam: float

    def matrix(self) -> np.ndarray:
        """Return the dense matrix A without its columns of zeros, in Fortran order."""
        full = dictionary.columns(self.q, np.arange(3 ** self.q.shape[1]))
        full *= self.weights[:, None]
        return np.asfortranarray(full / np.linalg.norm(full, axis=0))


def relative_gap(a: np.ndarray, problem: Problem, x: np.ndarray) -> float:
    """Return the duality gap of x relative to its objective, independent of the solver."""
    residual = problem.b - a @ x
    primal = 0.5 * residual @ residual + problem.lam * np.abs(x).sum()
    point = residual * min(1.0, problem.lam / np.abs(a.T @ residual).max())
    return float((primal - (point @ problem.b - 0.5 * point @ point)) / primal)


def eq17(seed: int = 0) -> dict[str, Problem]:
    """Return the moving joints of the iiwa on 500 samples of Yu 2022, Eq. (17), 0.1 N·m noise."""
    samples = synthesise(arms.iiwa7(), motions.eq17(), SynthesisOptions(
        static=True, seed=seed, noise=NoiseOptions(absolute=0.1)))
    return _loaded(samples, np.full(samples.tau.shape, 0.1))


def random_poses(seed: int = 0) -> dict[str, Problem]:
    """Return the loaded joints of the iiwa in 1000 random poses, 1 % noise (Yu 2022, Table 3)."""
    arm = arms.iiwa7()
    motion = motions.random_poses(arm.lower, arm.upper, 1000, seed)
    samples = synthesise(arm, motion, SynthesisOptions(static=True, seed=seed,
                                                       noise=NoiseOptions(relative=0.01)))
    floor = 1e-4 * np.sqrt((samples.tau ** 2).mean(axis=0)).max()
    return _loaded(samples, np.hypot(0.01 * samples.tau, floor))


def long_arm(n_joints: int, own: int = 6, seed: int = 0, count: int = 1000) -> Problem:
    """
    Return the most loaded joint of a drawn arm with right angles, 0.1 N·m noise.

    Joints beyond `own` are those of a massless hand: they move without influence on the torque.
    The gravity of a drawn arm of twelve joints with mass is not sparse in the dictionary.
    """
    own = min(own, n_joints)
    arm = generated_arm(seed, own, right_angles=True)
    rng = np.random.default_rng(seed)
    q = rng.uniform(-np.pi, np.pi, (count, n_joints))
    torque = arms.gravity_torque(arm, q[:, :own])
    b = torque[:, np.argmax(torque.std(axis=0))] + 0.1 * rng.normal(size=count)
    return Problem(q, np.full(count, 10.0), 10.0 * b, _universal(n_joints))


def _loaded(samples, sigma: np.ndarray) -> dict[str, Problem]:
    lam = _universal(samples.n_joints)
    # The first joint of a level arm and the last one have no gravity torque.
    return {name: Problem(samples.q, 1.0 / sigma[:, n], samples.tau[:, n] / sigma[:, n], lam)
            for n, name in enumerate(samples.names) if 0 < n < samples.n_joints - 1}


def _universal(n_joints: int) -> float:
    return float(np.sqrt(2.0 * n_joints * np.log(3.0)))
