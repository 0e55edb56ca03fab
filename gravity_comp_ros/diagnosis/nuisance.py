"""
Nuisance terms of a diagnosis, estimated jointly with gravity and separately for each joint.

They are Coulomb and viscous friction, an offset, and one row of constant inertias.
(`effects.motion_fit` fits all joints together where the joint axes are known.)
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_fit import (
    friction, friction_prior_std, samples_per_observation)
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np


def nuisance(motion: Motion, joint: int) -> FloatArray:
    """Return the columns (M, 3 + N) of Coulomb and viscous friction, an offset and inertia."""
    return np.column_stack([friction(motion, joint), motion.qdd])


def nuisance_torque(gravity: FloatArray, motion: Motion) -> FloatArray:
    """
    Return the torque (M, N) in N·m of friction, offset and inertia.

    :param gravity: (M, N, K) columns of gravity, fitted jointly.
    """
    k, samples = gravity.shape[2], motion.samples
    prior_std, torques = friction_prior_std(samples), []
    weight = np.sqrt(samples_per_observation(samples))
    sigma = residual_torque(gravity, motion).std(axis=0)
    for joint, tau in enumerate(samples.tau.T):
        columns = np.column_stack([gravity[:, joint], nuisance(motion, joint)])
        # A ridge regression: one further row for each coefficient with a prior.
        prior = np.zeros((prior_std.shape[1], columns.shape[1]))
        prior[:, k:k + len(prior)] = np.diag(sigma[joint] * weight / prior_std[joint])
        x = lstsq(np.vstack([columns, prior]), np.append(tau, np.zeros(len(prior))), rcond=1e-10)
        torques.append(columns[:, k:] @ x[k:])
    return np.column_stack(torques)


def residual_torque(gravity: FloatArray, motion: Motion) -> FloatArray:
    """Return the residual (M, N) in N·m of gravity (M, N, K) and nuisance terms."""
    explained = []
    for joint, tau in enumerate(motion.samples.tau.T):
        columns = np.column_stack([gravity[:, joint], nuisance(motion, joint)])
        explained.append(columns @ lstsq(columns, tau, rcond=1e-10))
    return np.asarray(motion.samples.tau - np.column_stack(explained))
