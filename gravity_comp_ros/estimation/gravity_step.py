"""
Gravity as a step away from a model, linear in a few numbers.

Refitting gravity beside effects must keep what makes a formulation good: one energy stays one
energy over the features it had, a chain stays a chain, and joints by themselves stay that. Each
is a step d with tau_n = g_n(q) + J_n(q) d, exact but for the chain's axes. A step is expected to
be no larger than what it changes, which decides where the recording says nothing: there the old
model stays.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.right_angles import TOLERANCE
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np

# rad; axes of a chain are known to about this before any data.
_AXES = 0.3
# An angle that is known to about this many times the exactness of an arm was taken as right.
_TAKEN = 1.5
_SMALLEST = 1e-3


@dataclass(frozen=True)
class Part:
    """Some columns (M, P) of one joint's torque, and which unknowns (P,) they belong to."""

    unknowns: IntArray
    columns: FloatArray


def step_scale(model: GravityModel) -> FloatArray:
    """Return how large each number of a step (K,) may reasonably be."""
    if model.chain is not None:
        moments = np.abs(model.chain.moments).ravel()
        return np.concatenate([_axes_scale(model, moments.size), _typical(moments)])
    return _typical(np.abs(_weights(model)))


def _axes_scale(model: GravityModel, size: int) -> FloatArray:
    """Return how far axes may turn: right angles that a fit took stay that."""
    if model.uncertainty is None:
        return np.full(size, _AXES)
    std = np.sqrt(np.maximum(np.diag(model.uncertainty.covariance)[:size], 0.0))
    return np.where((std > 0.0) & (std < _TAKEN * TOLERANCE), std, _AXES)


def step_from(origin: GravityModel, model: GravityModel) -> FloatArray:
    """Return the step (K,) from one model to another; axes of a chain count as unmoved."""
    if model.chain is not None and origin.chain is not None:
        change = (model.chain.moments - origin.chain.moments).ravel()
        return np.concatenate([np.zeros(change.size), change])
    return _weights(model) - _weights(origin)


def step_columns(model: GravityModel, q: FloatArray) -> list[Part]:
    """Return d tau_n / d step of every joint n at poses q (M, N)."""
    n = model.n_joints
    if model.chain is not None:
        jacobian = model.chain.jacobian(q)
        # Left out rather than held by its scale, so that the chain prints as short as it was.
        jacobian[:2 * n][_axes_scale(model, 2 * n) < _AXES] = 0.0
        return [_nonzero(jacobian[:, joint].T) for joint in range(n)]
    if model.energy is not None:
        flat = EnergyDesign(q, np.ones(q.shape)).columns(model.energy.indices)
        return [_nonzero(part) for part in flat.reshape(n, len(q), -1)]
    parts, first = [], 0
    for torque in model.torques:
        unknowns = first + np.arange(len(torque.indices))
        parts.append(Part(unknowns, dictionary.columns(q, torque.indices)))
        first += len(unknowns)
    return parts


def _weights(model: GravityModel) -> FloatArray:
    if model.energy is not None:
        return model.energy.weights
    return np.concatenate([torque.weights for torque in model.torques])


def _typical(sizes: FloatArray) -> FloatArray:
    """Return sizes, none below the usual one: a weight that is 0 by chance may well grow."""
    usual = float(np.median(sizes)) if sizes.size else 0.0
    return np.maximum(sizes, max(usual, _SMALLEST))


def _nonzero(columns: FloatArray) -> Part:
    present = np.flatnonzero(columns.any(axis=0))
    return Part(present, columns[:, present])
