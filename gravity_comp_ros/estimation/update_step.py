"""Change of a chain by new samples, without and with known link lengths."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.estimation.chain_update import NewSamples, Trial, update_chain
from gravity_comp_ros.estimation.options import OPTIONS
from gravity_comp_ros.estimation.payload_estimate import estimate_payload, PayloadEstimate
from gravity_comp_ros.estimation.payload_path import path_moments
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.sparse.sparse_change import Change
import numpy as np


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
    loaded = estimate_payload(model.chain, model.covariance, new, geometry)
    misfit, free_misfit = (float((each := new.residual(chain)) @ each)
                           for chain in (loaded.chain, free.model.chain))
    if misfit - free_misfit > OPTIONS.free:
        return replace(free, payload=loaded.payload, misfit=misfit)
    changed = (loaded.chain.moments - model.chain.moments).ravel()
    return UpdateStep(_with_chain(model, loaded.chain, loaded.covariance),
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
    result = update_chain(model.chain, model.covariance, new, box, trials, path)
    names, moments = _moment_names(model), result.chain.moments - model.chain.moments
    changed = {names[k]: float(moments.ravel()[k])
               for k in result.change.support - 2 * model.n_joints}
    return UpdateStep(_with_chain(model, result.chain, result.covariance), changed,
                      result.change, trials=result.trials)


def _with_chain(model: GravityModel, chain: Chain, covariance: FloatArray) -> GravityModel:
    return replace(model, torques=(), energy=expand(chain), chain=chain, covariance=covariance)
