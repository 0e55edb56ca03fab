"""
Change of a chain by new samples, without and with known link lengths.

With them it is a payload. Its gravity torque is linear in its mass m and its first moment m c
(Yu 2022, Eq. (19), has the same four parameters for every link). They are fitted jointly with a
step u of the old model within its covariance C:

    tau - g_old(q) = T(q) [m, m c] + J(q) u + noise,    u ~ N(0, C),

so that their intervals include the old model's uncertainty and the noise of the new samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.chain_update import NewSamples, Trial, update_chain
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.estimation.payload_path import path_moments
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.sparse.sparse_change import Change
import numpy as np

_DRAWS = 4000


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


@dataclass(frozen=True)
class UpdateStep:
    """
    A changed model with its changed coefficients, in N·m by name.

    `payload` is the estimate, None without link lengths; `misfit` is its chi^2, and `is_payload`
    is True where the model changed by it. `trials` are the probable ones of the search for a
    chain, for another search with other noise.
    """

    model: GravityModel
    changed: dict[str, float]
    change: Change
    payload: PayloadEstimate | None = None
    is_payload: bool = False
    misfit: float = 0.0
    trials: tuple[Trial, ...] = ()


def changed_model(model: GravityModel, new: NewSamples, geometry: Geometry | None,
                  trials: tuple[Trial, ...] = ()) -> UpdateStep:
    """
    Return the change of a chain with a covariance that explains new samples.

    :param geometry: of the arm, to estimate the payload; the chain is on its axes then.
    :param trials: those of an earlier step with other noise.
    """
    free = _chain_step(model, new, trials)
    return free if geometry is None else _payload_step(model, new, geometry, free)


def _payload_step(model: GravityModel, new: NewSamples, geometry: Geometry,
                  free: UpdateStep) -> UpdateStep:
    """Return the change by a payload, or the free one if that fits much better."""
    assert model.chain is not None and model.covariance is not None
    assert free.model.chain is not None
    loaded = estimate_payload(model.chain, model.covariance_given_effects, new, geometry)
    misfit, free_misfit = (float((each := new.residual(chain)) @ each)
                           for chain in (loaded.chain, free.model.chain))
    if misfit - free_misfit > OPTIONS.free:
        return replace(free, payload=loaded.payload, misfit=misfit)
    changed = (loaded.chain.moments - model.chain.moments).ravel()
    return UpdateStep(model.with_chain(loaded.chain, loaded.covariance),
                      {name: float(x) for name, x in zip(_moment_names(model), changed)},
                      free.change, loaded.payload, True, misfit, free.trials)


def _moment_names(model: GravityModel) -> list[str]:
    return [f'{name} {axis}' for name in model.joints for axis in 'xy']


def _chain_step(model: GravityModel, new: NewSamples,
                trials: tuple[Trial, ...]) -> UpdateStep:
    assert model.chain is not None and model.covariance is not None
    box = np.stack([model.coverage.q_min, model.coverage.q_max])
    path = None if model.payload_path is None else path_moments(
        model.payload_path, model.chain, box)
    result = update_chain(model.chain, model.covariance_given_effects, new, box, trials, path)
    names, moments = _moment_names(model), result.chain.moments - model.chain.moments
    changed = {names[k]: float(moments.ravel()[k])
               for k in result.change.support - 2 * model.n_joints}
    return UpdateStep(model.with_chain(result.chain, result.covariance), changed,
                      result.change, trials=result.trials)


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
    payload_std = np.array([1.0, *3 * [OPTIONS.distance]]) * OPTIONS.mass
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
    return LoadedChain(chain.moved(to_step @ coefficients), step_covariance,
                       _mass_and_centre(coefficients[:4], posterior[:4, :4], geometry.link))


def _mass_and_centre(mean: FloatArray, covariance: FloatArray, link: str) -> PayloadEstimate:
    """Return mass and centre with 95 % intervals from the posterior of [m, m c]."""
    value, sigma = float(mean[0]), float(np.sqrt(covariance[0, 0]))
    mass = Quantity.around(value, 'kg', HALF_95 * sigma)
    if abs(value) < OPTIONS.significant * sigma:
        return PayloadEstimate(link, mass, None)
    draws = np.random.default_rng(0).multivariate_normal(mean, covariance, _DRAWS)
    low, high = np.percentile(draws[:, 1:] / draws[:, :1], [2.5, 97.5], axis=0)
    return PayloadEstimate(link, mass, {
        axis: Quantity(float(mean[k] / value), 'm', (float(low[k - 1]), float(high[k - 1])))
        for k, axis in enumerate('xyz', start=1)})
