"""
L1 problems of simulated arms, and solvers of them.

Rows are in units of the noise. The other solvers get the dense matrix, with columns of unit
length; ours gets its Kronecker factors and the column lengths. Each solver has its own definition
of tolerance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
import warnings

from bench.cases.arms import generated_arm
from gravity_comp_ros.data.samples import JointSamples
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.lasso import LassoProblem
from gravity_comp_ros.models.sparse.regressor import TorqueDesign
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


def eq17(seed: int = 0) -> Problem:
    """Return joint 2 of the iiwa on 500 samples of Yu 2022, Eq. (17), 0.1 N·m noise."""
    samples = synthesise(arms.iiwa7(), motions.eq17(), SynthesisOptions(
        static=True, seed=seed, noise=NoiseOptions(absolute=0.1)))
    return _joint_2(samples, np.full(samples.tau.shape, 0.1))


def random_poses(seed: int = 0) -> Problem:
    """Return joint 2 of the iiwa in 1000 random poses, 1 % noise (Yu 2022, Table 3)."""
    arm = arms.iiwa7()
    motion = motions.random_poses(arm.lower, arm.upper, 1000, seed)
    samples = synthesise(arm, motion, SynthesisOptions(static=True, seed=seed,
                                                       noise=NoiseOptions(relative=0.01)))
    floor = 1e-4 * np.sqrt((samples.tau ** 2).mean(axis=0)).max()
    return _joint_2(samples, np.hypot(0.01 * samples.tau, floor))


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


def _joint_2(samples: JointSamples, sigma: np.ndarray) -> Problem:
    return Problem(samples.q, 1.0 / sigma[:, 1], samples.tau[:, 1] / sigma[:, 1],
                   _universal(samples.n_joints))


def _universal(n_joints: int) -> float:
    return float(np.sqrt(2.0 * n_joints * np.log(3.0)))


# Coefficients x of columns of unit length, and iterations.
Answer = tuple[np.ndarray, int]


@dataclass(frozen=True)
class Solver:
    """A solver with its call `solve(problem, a, tolerance)`, tolerances from loose to tight."""

    name: str
    solve: Callable[[Problem, Any, float], Answer]
    tolerances: tuple[float, ...]


def ours(problem: Problem, design: TorqueDesign, tolerance: float) -> Answer:
    lasso = LassoProblem(design, problem.b, np.ones(design.n_columns, dtype=bool))
    solution = lasso.solve(problem.lam)
    if not solution.certificate.gap <= 1e-6:
        raise RuntimeError(f'gap {solution.certificate.gap}')
    x = np.zeros(design.n_columns)
    x[solution.indices] = solution.x * np.sqrt(design.squared_norms[solution.indices])
    return x, solution.iterations


def factors(problem: Problem) -> TorqueDesign:
    """Return the implicit matrix of our solver: its Kronecker factors and column lengths."""
    design = TorqueDesign(problem.q, problem.weights[:, None])
    _ = design.squared_norms
    return design


def _lasso(lasso: Any, problem: Problem, a: np.ndarray, tolerance: float, **limits: int) -> Answer:
    """Solve with a Lasso class of scikit-learn's interface."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        fit = lasso(problem.lam / len(problem.b), fit_intercept=False, tol=tolerance,
                    **limits).fit(a, problem.b)
    return fit.coef_, int(fit.n_iter_)


def scikit_learn(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    from sklearn.linear_model import Lasso
    return _lasso(Lasso, problem, a, tolerance, max_iter=10 ** 6)


def celer(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    from celer import Lasso
    return _lasso(Lasso, problem, a, tolerance, max_iter=1000, max_epochs=10 ** 6)


def skglm(problem: Problem, a: np.ndarray, tolerance: float) -> Answer:
    from skglm import Lasso
    return _lasso(Lasso, problem, a, tolerance, max_iter=1000, max_epochs=10 ** 6)


OURS = Solver('gravity_comp_ros', ours, (1e-7,))
OTHERS = (
    Solver('scikit-learn', scikit_learn, (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)),
    Solver('celer', celer, (1e-4, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)),
    Solver('skglm', skglm, (1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)))
