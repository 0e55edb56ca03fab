"""Derivatives of the gravity torque by the parameters of a model, and their prior."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.models.uncertainty import EnergyUncertainty
import numpy as np

# Prior standard deviation of axis directions, rad; that of moments is their own size.
_AXIS_STD = 0.3


def covariance_columns(model: GravityModel, q: FloatArray) -> FloatArray:
    """Return the derivatives by the parameters of the model's covariance, (M, N, K)."""
    if model.chain is not None:
        return np.asarray(model.chain.jacobian(q).transpose(2, 1, 0))
    assert isinstance(model.uncertainty, EnergyUncertainty)
    return _energy_columns(model, q, model.uncertainty.indices)


def free_columns(model: GravityModel, q: FloatArray) -> FloatArray:
    """Return the derivatives by the free parameters, (M, N, K)."""
    if model.chain is not None:
        return model.chain.jacobian(q).transpose(2, 1, 0)[:, :, _first_free(model):]
    if model.energy is None:
        raise OptionError('plan needs a model with an energy: fit a chain or a potential')
    return _energy_columns(model, q, model.energy.indices)


def free_prior_std(model: GravityModel) -> FloatArray:
    """Return the prior standard deviations (K,) of the free parameters."""
    if model.chain is not None:
        n = model.n_joints
        largest = max(float(np.abs(model.chain.moments).max()), 1e-3)
        std = np.concatenate([np.full(2 * n, _AXIS_STD), np.full(2 * n, largest)])
        return std[_first_free(model):]
    if model.energy is None:
        raise OptionError('plan needs a model with an energy: fit a chain or a potential')
    largest = max(float(np.abs(model.energy.weights).max(initial=0.0)), 1e-3)
    return np.full(len(model.energy.indices), largest)


def _energy_columns(model: GravityModel, q: FloatArray, indices: IntArray) -> FloatArray:
    columns = np.asarray(EnergyDesign(q, np.ones_like(q)).columns(indices))
    return columns.reshape(model.n_joints, len(q), -1).transpose(1, 0, 2)


def _first_free(model: GravityModel) -> int:
    """
    Return the number of the first free parameter of a chain.

    The first two rotate the base, and base tilt is an effect of its own. With known axes only the
    moments are free.
    """
    return 2 if model.geometry is None else 2 * model.n_joints
