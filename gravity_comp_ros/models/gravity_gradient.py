"""Gravity stiffness: the derivative of a model's gravity torque by the pose, in closed form."""

from __future__ import annotations

from gravity_comp_ros.data.poses import batches
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse import dictionary
import numpy as np


def gravity_gradient(model: GravityModel, q: FloatArray) -> FloatArray:
    """
    Return d gravity_n / d q_j in N·m/rad, shape (M, N, N) with n before j.

    The derivative of a feature is again a feature (Yu 2022, Property 1).

    :param q: poses (M, N) in rad.
    """
    n = model.n_joints
    if model.chain is not None:
        return model.chain.gradient(q)
    parts = [torque.gradient(n, j) for torque in model.torques for j in range(n)]
    features = np.unique(np.concatenate([part.indices for part in parts]))
    weights = np.zeros((len(features), n * n))
    for place, part in enumerate(parts):
        np.add.at(weights[:, place], np.searchsorted(features, part.indices), part.weights)
    out = np.zeros((len(q), n * n))
    for rows in batches(len(q)):
        out[rows] = dictionary.columns(q[rows], features) @ weights
    return out.reshape(len(q), n, n)
