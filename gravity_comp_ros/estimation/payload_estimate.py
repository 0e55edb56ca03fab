"""
Payload mass and centre of mass, for an arm with known link lengths.

The gravity torque of a payload is linear in its mass m and its first moment m c (Yu 2022,
Eq. (19), has the same four parameters for every link). They are fitted jointly with a step u of
the old model within its covariance C:

    tau - g_old(q) = T(q) [m, m c] + J(q) u + noise,    u ~ N(0, C),

so that their intervals include the old model's uncertainty and the noise of the new samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.poses import random_poses
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.estimation.chain_update import NewSamples
from gravity_comp_ros.estimation.change_options import CHANGE
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_solver import ChainProblem
from gravity_comp_ros.models.kinematic.geometry import Geometry, same_axes
from gravity_comp_ros.models.kinematic.known_axes import (
    right_angles_kept, solve_known, step_covariance)
from gravity_comp_ros.models.kinematic.vertical import with_estimated_vertical
import numpy as np

_DRAWS = 4000
# Minimum and maximum number of poses that replace an old model's training samples.
_MIN_POSES, _MAX_POSES = 200, 1000


@dataclass(frozen=True)
class PayloadEstimate:
    """
    A payload: its `mass` in kg, and its `centre` in m by axis in the coordinates of `link`.

    The centre is None if the mass does not differ from 0. A removed payload has a negative mass.
    """

    link: str
    mass: Quantity
    centre: Mapping[str, Quantity] | None


@dataclass(frozen=True)
class LoadedChain:
    """The chain with the payload, the covariance of a step from it, and the payload."""

    chain: Chain
    covariance: FloatArray
    payload: PayloadEstimate


def estimate_payload(chain: Chain, covariance: FloatArray, new: NewSamples,
                     geometry: Geometry) -> LoadedChain:
    """
    Return the chain with the payload that best explains the new samples.

    :param chain: on the axes of `geometry`; of the arm before the change.
    :param covariance: of a step from the chain (4N, 4N).
    """
    n = chain.n_joints
    # Rows: chain step per unit of [m, m c]; then of every coefficient, payload and step u.
    payload_steps = np.hstack([np.zeros((4, 2 * n)), geometry.tool_moments()])
    columns = new.columns(chain)
    regressor = np.concatenate([payload_steps @ columns, columns])
    payload_std = np.array([1.0, *3 * [CHANGE.distance]]) * CHANGE.mass
    prior = np.zeros((4 + 4 * n, 4 + 4 * n))
    prior[:4, :4] = np.diag(payload_std ** 2)
    prior[4:, 4:] = covariance
    # Written with the prior covariance, not its inverse: that of exactly known axes is singular.
    inverse = np.linalg.inv(np.eye(len(prior)) + prior @ (regressor @ regressor.T))
    posterior = inverse @ prior
    posterior = 0.5 * (posterior + posterior.T)
    coefficients = posterior @ (regressor @ new.residual(chain))
    to_step = np.hstack([payload_steps.T, np.eye(4 * n)])
    step_covariance = to_step @ posterior @ to_step.T
    loaded = chain.moved(right_angles_kept(to_step @ coefficients, step_covariance, covariance))
    return LoadedChain(loaded, step_covariance,
                       _mass_and_centre(coefficients[:4], posterior[:4, :4], geometry.link))


def _mass_and_centre(mean: FloatArray, covariance: FloatArray, link: str) -> PayloadEstimate:
    """Return mass and centre with 95 % intervals from the posterior of [m, m c]."""
    value, sigma = float(mean[0]), float(np.sqrt(covariance[0, 0]))
    mass = Quantity(value, 'kg', (value - HALF_95 * sigma, value + HALF_95 * sigma))
    if abs(value) < CHANGE.significant * sigma:
        return PayloadEstimate(link, mass, None)
    draws = np.random.default_rng(0).multivariate_normal(mean, covariance, _DRAWS)
    low, high = np.percentile(draws[:, 1:] / draws[:, :1], [2.5, 97.5], axis=0)
    return PayloadEstimate(link, mass, {
        axis: Quantity(float(mean[k] / value), 'm', (float(low[k - 1]), float(high[k - 1])))
        for k, axis in enumerate('xyz', start=1)})


def on_known_axes(model: GravityModel, geometry: Geometry, *, as_described: bool = False
                  ) -> tuple[Chain, FloatArray, Geometry]:
    """
    Return a model's gravity as a chain on known axes, its covariance, and the axes.

    The covariance is that of a step from the chain; the axes have the vertical and the zero
    angles of the model. A chain that was fitted on these axes is returned as it is. Any other
    model is sampled at poses within its trained range, with its torque and its noise.

    :param as_described: whether to keep the vertical and the zero angles of `geometry`.

    :raises ModelMismatchError: if no moments on these axes reproduce the model: they are of
        another arm, or of one with other zero angles.
    """
    if sorted(model.joints) != sorted(geometry.joints):
        raise ModelMismatchError(f'the known axes are of {", ".join(geometry.joints)}, but the '
                                 f'model is of {", ".join(model.joints)}')
    own = geometry
    if not as_described and model.geometry is not None and same_axes(model.geometry, geometry):
        own = model.geometry
    if (model.chain is not None and model.uncertainty is not None
            and model.joints == own.joints and not as_described
            and np.abs(model.chain.axes[1:] - own.rotations[1:]).max(initial=0.0) < 1e-9):
        return model.chain, model.uncertainty.covariance, own
    q, tau, sigma = _resampled(model, geometry)
    if not as_described:
        geometry = with_estimated_vertical(geometry, JointSamples.single_run(
            geometry.joints, np.arange(len(q)), q, np.zeros_like(q), tau),
            np.sqrt((sigma ** 2).mean(axis=0)))
    weight = np.sqrt(max(model.coverage.n_samples, 1) / len(q))
    solution = solve_known(ChainProblem(q, tau, weight / sigma), geometry.rotations,
                           mounted=as_described)
    chain = solution.chain
    _check_misfit(tau - chain.torque(q), sigma, geometry.joints)
    return chain, step_covariance(solution), geometry


def _resampled(model: GravityModel, geometry: Geometry
               ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return poses within the trained range, torques and their std, joints as in `geometry`."""
    order = [model.joints.index(name) for name in geometry.joints]
    count = int(np.clip(model.coverage.n_samples, _MIN_POSES, _MAX_POSES))
    q = random_poses(geometry.n_joints, model.coverage.q_min, model.coverage.q_max, count)
    tau, std = model.predict(q), np.zeros(q.shape)
    if model.uncertainty is not None:
        std = model.predict_std(q)
    sigma = np.hypot(np.maximum(model.noise, 1e-3 * np.abs(tau).max() + 1e-9), 3.0 * std)
    return q[:, order], tau[:, order], sigma[:, order]


def _check_misfit(residual: FloatArray, sigma: FloatArray, joints: tuple[str, ...]) -> None:
    """Raise ModelMismatchError if a residual (M, N) in N·m is large against its std."""
    misfit = np.sqrt(((residual / sigma) ** 2).mean(axis=0))
    worst = int(np.argmax(misfit))
    if misfit[worst] > CHANGE.max_misfit:
        rms = float(np.sqrt((residual ** 2).mean(axis=0))[worst])
        raise ModelMismatchError(
            f'the known axes do not reproduce the model: the torque of joint {joints[worst]} '
            f'differs by {rms:.2g} N·m within the trained range. `gravity_comp check` names what '
            f'differs: an axis, a zero angle; a per_joint model may be of no arm: fit a chain')
