"""
A tool weighed by the arm that holds it, where the arm's lengths are known.

What a tool adds to gravity is linear in its mass m and its first moment m c (Yu 2022, Eq. (19)
has the same four numbers for every link). They are fitted together with what was not sure about
the arm before:

    tau - g_old(q) = T(q) [m, m c] + J(q) u + noise,    u ~ N(0, C),

so that their intervals hold the old model's uncertainty as well as the noise of new samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.estimation.chain_update import NewSamples
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.known_axes import solve_known
from gravity_comp_ros.models.kinematic.right_angles import right_angles_kept
from gravity_comp_ros.models.kinematic.vertical import with_estimated_vertical
from gravity_comp_ros.models.kinematic.zero_angles import same_axes
import numpy as np

# What a tool may weigh before any data, kg, and how far its centre may be, m.
_USUAL_MASS, _USUAL_DISTANCE = 30.0, 0.5
# A mass below this many standard deviations has no centre worth telling.
_TOLD = 4.0
_DRAWS = 4000
# Poses that stand for an old model's training.
_FEWEST_POSES, _MOST_POSES = 200, 1000
# Known axes must repeat the old model to this share of what it is unsure of.
_REPEATS = 0.5


@dataclass(frozen=True)
class PayloadEstimate:
    """
    A tool: its `mass` in kg, and its `centre` in m by axis in the coordinates of `link`.

    The centre is None where the mass is not told from 0. What came off has a negative mass.
    """

    link: str
    mass: Quantity
    centre: Mapping[str, Quantity] | None


@dataclass(frozen=True)
class Tool:
    """The chain with the tool, the covariance of a step from it, and the tool by itself."""

    chain: Chain
    covariance: FloatArray
    weighed: PayloadEstimate


def weigh(chain: Chain, covariance: FloatArray, new: NewSamples, geometry: Geometry) -> Tool:
    """
    Return the chain with the tool that explains the new samples best.

    :param chain: on the axes of `geometry`; of the arm before the change.
    :param covariance: of a step from the chain (4N, 4N).
    """
    n = chain.n_joints
    tool = np.hstack([np.zeros((4, 2 * n)), geometry.tool_moments()])
    columns = new.columns(chain)
    every = np.concatenate([tool @ columns, columns])
    usual = np.array([1.0, *3 * [_USUAL_DISTANCE]]) * _USUAL_MASS
    prior = np.zeros((4 + 4 * n, 4 + 4 * n))
    prior[:4, :4] = np.diag(usual ** 2)
    prior[4:, 4:] = covariance
    # Written with the prior's covariance, not its inverse: an axis that is known has none.
    inverse = np.linalg.inv(np.eye(len(prior)) + prior @ (every @ every.T))
    spread = inverse @ prior
    spread = 0.5 * (spread + spread.T)
    residual = new.residual(chain)
    found = spread @ (every @ residual)
    onto_step = np.hstack([tool.T, np.eye(4 * n)])
    after = onto_step @ spread @ onto_step.T
    loaded = chain.moved(right_angles_kept(onto_step @ found, after, covariance))
    return Tool(loaded, after, _weighed(found[:4], spread[:4, :4], geometry.link))


def _weighed(found: FloatArray, spread: FloatArray, link: str) -> PayloadEstimate:
    value, sigma = float(found[0]), float(np.sqrt(spread[0, 0]))
    mass = Quantity(value, 'kg', (value - 1.96 * sigma, value + 1.96 * sigma))
    if abs(value) < _TOLD * sigma:
        return PayloadEstimate(link, mass, None)
    draws = np.random.default_rng(0).multivariate_normal(found, spread, _DRAWS)
    low, high = np.percentile(draws[:, 1:] / draws[:, :1], [2.5, 97.5], axis=0)
    return PayloadEstimate(link, mass, {
        axis: Quantity(float(found[k] / value), 'm', (float(low[k - 1]), float(high[k - 1])))
        for k, axis in enumerate('xyz', start=1)})


def on_known_axes(model: GravityModel, geometry: Geometry
                  ) -> tuple[Chain, FloatArray, Geometry]:
    """
    Return a model's gravity as a chain on known axes, and the covariance of a step from it.

    Third come the axes, on the vertical and with the zero angles that the model has.
    A model that was fitted on these axes is that already. Of any other, poses within its trained
    range stand for its training, with its torque and its noise.

    :raises ModelMismatchError: if no moments on these axes repeat the model: they are of another
        arm, or of one that counts its angles from elsewhere.
    """
    if sorted(model.joints) != sorted(geometry.joints):
        raise ModelMismatchError(f'axes are known of {", ".join(geometry.joints)}, but the model '
                                 f'is of {", ".join(model.joints)}')
    n = geometry.n_joints
    own = geometry
    if model.geometry is not None and same_axes(model.geometry, geometry):
        own = model.geometry
    if (model.chain is not None and model.uncertainty is not None
            and model.joints == own.joints
            and np.abs(model.chain.axes[1:] - own.rotations[1:]).max(initial=0.0) < 1e-9):
        return model.chain, model.uncertainty.covariance, own
    order = [model.joints.index(name) for name in geometry.joints]
    count = int(np.clip(model.coverage.n_samples, _FEWEST_POSES, _MOST_POSES))
    rng = np.random.default_rng(0)
    q = rng.uniform(model.coverage.q_min, model.coverage.q_max, (count, n))
    tau, std = model.predict(q), np.zeros((count, n))
    if model.uncertainty is not None:
        std = model.predict_std(q)
    worth = np.sqrt(max(model.coverage.n_samples, 1) / count)
    sigma = np.hypot(np.maximum(model.noise, 1e-3 * np.abs(tau).max() + 1e-9), 3.0 * std)
    geometry = with_estimated_vertical(geometry, JointSamples.single_run(
        geometry.joints, np.arange(count), q[:, order], np.zeros_like(q), tau[:, order]))
    problem = ChainProblem(q[:, order], tau[:, order], (worth / sigma)[:, order])
    found = solve_known(problem, geometry.rotations)
    chain = found.solution.chain
    left = (problem.tau - chain.torque(problem.q)) / sigma[:, order]
    missed = np.sqrt((left ** 2).mean(axis=0))
    worst = int(np.argmax(missed))
    if missed[worst] > _REPEATS:
        wrong = float(np.sqrt(((left * sigma[:, order]) ** 2).mean(axis=0))[worst])
        raise ModelMismatchError(
            f'the known axes do not repeat the model: joint {geometry.joints[worst]} is off by '
            f'{wrong:.2g} N·m where the model was trained. Is the URDF of this arm, with the same '
            f'zero angles?')
    return chain, found.covariance(), geometry
