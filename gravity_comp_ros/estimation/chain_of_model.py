"""
Gravity of a model as a chain of joints, against which a change of the payload is tested.

A potential model of a serial arm and its chain predict the same torque. A chain fitted to the
torque of a potential model, at the poses with the smallest standard deviation, separates the
gravity of that model by links.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, FitError, ModelMismatchError
from gravity_comp_ros.estimation.payload_estimate import on_known_axes
from gravity_comp_ros.estimation.update import effects_on_axes
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.uncertainty import ChainUncertainty
from gravity_comp_ros.regression.engine import regress
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import start_axes
from gravity_comp_ros.regression.unknown_lengths import UnknownLengths
import numpy as np

# Number of poses drawn from the trained range for a chain, and of those with the smallest
# standard deviation; largest RMS error of the chain in units of the model's noise.
_DRAWN, _KEPT, _MAX_ERROR = 600, 200, 1.0


def axes_under(model: GravityModel, geometry: Geometry | None) -> Geometry | None:
    """Return the axes of a chain, its own or those described; None if it has neither."""
    for axes in (model.geometry, geometry):
        if axes is not None and model.chain is not None and model.joints == axes.joints and (
                np.abs(model.chain.axes[1:] - axes.rotations[1:]).max(initial=0.0) < 1e-6):
            return axes
    return None


class ChainOfModel:
    """Converts models to chains; keeps the last one."""

    def __init__(self) -> None:
        self._key: bytes = b''
        self._chain: GravityModel | None = None

    def of(self, model: GravityModel, geometry: Geometry | None) -> GravityModel | None:
        """Return the gravity of a model as a chain, None where no chain explains it."""
        parts = [part for torque in model.torques for part in (torque.indices, torque.weights)]
        if geometry is not None:
            parts += [geometry.rotations, geometry.origins]
        effects = repr((model.applied.effects, model.fitted.effects)).encode()
        key = effects + b'|'.join(np.ascontiguousarray(part).tobytes() for part in parts)
        if key != self._key:
            self._key, self._chain = key, as_chain(model, geometry)
        return self._chain


def as_chain(model: GravityModel, geometry: Geometry | None = None) -> GravityModel | None:
    """
    Return the gravity of a model as a chain model of the same joints in the same order.

    :param geometry: axes of the arm where they are known; the chain then has these axes.
    """
    if geometry is not None and geometry.joints == model.joints:
        with suppress(ModelMismatchError, np.linalg.LinAlgError):
            return _chain_model(model, *on_known_axes(model, geometry))
    if model.chain is not None and model.uncertainty is not None:
        return model
    if model.uncertainty is None:
        return None
    rng = np.random.default_rng(0)
    q = rng.uniform(model.coverage.q_min, model.coverage.q_max, (_DRAWN, model.n_joints))
    noise = np.maximum(model.noise, 1e-3 * float(model.noise.max()) + 1e-9)
    q = q[np.argsort((model.predict_std(q) / noise).max(axis=1))[:_KEPT]]
    torque = model.predict(q)
    samples = JointSamples.single_run(
        model.joints, np.arange(len(q)), q, np.zeros_like(q),
        torque + noise * rng.standard_normal(q.shape))
    try:
        problem = Problem.of(samples)
        result = regress(problem, start_axes(problem, ()), ())
    except (FitError, DataError, np.linalg.LinAlgError):
        return None
    shared = result.shared
    assert isinstance(shared, UnknownLengths)
    error = np.sqrt(((shared.chain.torque(q) - torque) ** 2).mean(axis=0))
    if (error > _MAX_ERROR * noise).any():
        return None
    steps, p = shared.step_map(), len(shared.point)
    return _chain_model(model, shared.chain, steps @ result.posterior.covariance[:p, :p] @ steps.T)


def _chain_model(model: GravityModel, chain: Chain, covariance: FloatArray,
                 geometry: Geometry | None = None) -> GravityModel:
    result = GravityModel.from_energy(
        model.joints, 'chain', expand(chain), model.noise, model.coverage, model.provenance,
        chain, ChainUncertainty(chain, covariance))
    applied, fitted = effects_on_axes(model)
    return replace(result, applied=applied, history=model.history, fitted=fitted,
                   residual_std=model.residual_std, payload_path=model.payload_path,
                   geometry=geometry)
