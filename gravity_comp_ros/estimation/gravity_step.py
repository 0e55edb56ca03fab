"""
Linear regressor of a change of gravity, for each formulation.

A joint refit of gravity and effects must keep the formulation: one energy over the same features,
a chain, or a separate torque for each joint. The change is a step d with
tau_n = g_n(q) + J_n(q) d, exact except for the axes of a chain. The prior std of each step is the
size of the parameter that it changes; without data the old model stays.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.right_angles import TOLERANCE
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
import numpy as np

# Prior std of a chain's axes, in rad.
_AXIS_STD = 0.3
# Maximum std of an angle that counts as a right angle, in multiples of `TOLERANCE`.
_MAX_RIGHT_ANGLE_STD = 1.5
_MIN_SCALE = 1e-3


@dataclass(frozen=True)
class Part:
    """Some columns (M, P) of one joint's torque, and the indices (P,) of their unknowns."""

    unknowns: IntArray
    columns: FloatArray


def step_scale(model: GravityModel) -> FloatArray:
    """Return the prior standard deviation (K,) of each number of a step."""
    if model.chain is not None:
        moments = np.abs(model.chain.moments).ravel()
        return np.concatenate([_axes_scale(model, moments.size), _at_least_median(moments)])
    return _at_least_median(np.abs(_weights(model)))


def _axes_scale(model: GravityModel, size: int) -> FloatArray:
    """Return the prior standard deviation in rad of the axes; right angles stay right."""
    if model.uncertainty is None:
        return np.full(size, _AXIS_STD)
    std = np.sqrt(np.maximum(np.diag(model.uncertainty.covariance)[:size], 0.0))
    return np.where((std > 0.0) & (std < _MAX_RIGHT_ANGLE_STD * TOLERANCE), std, _AXIS_STD)


def step_columns(model: GravityModel, q: FloatArray) -> list[Part]:
    """Return d tau_n / d step of every joint n at poses q (M, N)."""
    n = model.n_joints
    if model.chain is not None:
        jacobian = model.chain.jacobian(q)
        # Right angles are fixed, not only given a small prior std, so that the chain stays short.
        jacobian[:2 * n][_axes_scale(model, 2 * n) < _AXIS_STD] = 0.0
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


def _at_least_median(sizes: FloatArray) -> FloatArray:
    """Return sizes, none below the median: a weight may be 0 by coincidence."""
    median = float(np.median(sizes)) if sizes.size else 0.0
    return np.maximum(sizes, max(median, _MIN_SCALE))


def _nonzero(columns: FloatArray) -> Part:
    present = np.flatnonzero(columns.any(axis=0))
    return Part(present, columns[:, present])
