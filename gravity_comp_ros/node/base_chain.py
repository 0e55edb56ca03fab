"""
The model in use as a chain: the structure of the arm, against which a change is tested.

A potential model of a serial arm predicts what a chain predicts. A chain fitted to its own torque,
at poses where it is sure, is the same gravity with the links told apart.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import DataError, FitError, ModelMismatchError
from gravity_comp_ros.estimation.payload_estimate import on_known_axes
from gravity_comp_ros.estimation.update import update
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import Chain
from gravity_comp_ros.models.kinematic.chain_fit import fit_chain
from gravity_comp_ros.models.kinematic.expansion import expand
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.uncertainty import ChainUncertainty
import numpy as np

# Poses drawn from the trained range, and those of them that stand for the training: the surest.
_DRAWN, _KEPT = 600, 200
# A chain that is further than this from the model, in units of its noise, is another arm's.
_SAME = 1.0


class BaseChains:
    """Turns models into chains, and remembers the last one: an epoch asks for the same again."""

    def __init__(self) -> None:
        self._key: bytes = b''
        self._chain: GravityModel | None = None

    def of(self, model: GravityModel, geometry: Geometry | None) -> GravityModel | None:
        """Return the same gravity as a chain, None where no chain of this arm explains it."""
        key = _key(model, geometry)
        if key != self._key:
            self._key, self._chain = key, as_chain(model, geometry)
        return self._chain


def as_chain(model: GravityModel, geometry: Geometry | None = None) -> GravityModel | None:
    """
    Return the gravity of a model as a chain model of the same joints, in their order.

    :param geometry: of the arm, where it is known; the chain then lies on its axes.
    """
    if geometry is not None and geometry.joints == model.joints:
        with suppress(ModelMismatchError, np.linalg.LinAlgError):
            return _made(model, *on_known_axes(model, geometry))
    if model.chain is not None and model.uncertainty is not None:
        return model
    return _fitted(model)


def _fitted(model: GravityModel) -> GravityModel | None:
    if model.uncertainty is None:
        return None
    rng = np.random.default_rng(0)
    low, high = model.coverage.q_min, model.coverage.q_max
    q = rng.uniform(low, high, (_DRAWN, model.n_joints))
    noise = np.maximum(model.noise, 1e-3 * float(model.noise.max()) + 1e-9)
    doubt = (model.predict_std(q) / noise).max(axis=1)
    q = q[np.argsort(doubt)[:_KEPT]]
    torque = model.predict(q)
    samples = JointSamples.single_run(
        model.joints, np.arange(len(q)), q, np.zeros_like(q),
        torque + noise * rng.standard_normal(q.shape))
    try:
        found = fit_chain(samples)
    except (FitError, DataError, np.linalg.LinAlgError):
        return None
    error = np.sqrt(((found.chain.torque(q) - torque) ** 2).mean(axis=0))
    if (error > _SAME * noise).any():
        return None
    return _made(model, found.chain, found.covariance)


def _made(model: GravityModel, chain: Chain, covariance: FloatArray,
          geometry: Geometry | None = None) -> GravityModel:
    made = GravityModel.from_energy(
        model.joints, 'chain', expand(chain), model.noise, model.coverage, model.provenance,
        chain, ChainUncertainty(chain, covariance))
    return replace(made, applied=model.applied, history=model.history, nuisance=model.nuisance,
                   payload_path=model.payload_path, geometry=geometry)


def changed_by_payload(chain: GravityModel, gravity: JointSamples) -> GravityModel:
    """
    Return a chain with what a payload changed of it, on known axes if it lies on such.

    :param gravity: of the arm with the payload, in the joints' order of the chain.
    :raises FitError: if there are too few samples.
    """
    return update(chain, gravity, geometry=chain.geometry).model


def without_friction(chain: GravityModel) -> GravityModel:
    """Return a model for samples whose friction and offset have been subtracted."""
    return replace(chain, nuisance=replace(chain.nuisance, terms=()))


def _key(model: GravityModel, geometry: Geometry | None) -> bytes:
    parts = [part for torque in model.torques for part in (torque.indices, torque.weights)]
    if geometry is not None:
        parts += [geometry.rotations, geometry.origins]
    return b'|'.join(np.ascontiguousarray(part).tobytes() for part in parts)
