"""
Nuisance terms of a diagnosis, estimated jointly with gravity and separately for each joint.

They are Coulomb and viscous friction, an offset, and one row of constant inertias.
(`effects.motion_fit` fits all joints together where the joint axes are known.)
"""

from __future__ import annotations

from collections.abc import Iterator

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_fit import friction
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
    k = gravity.shape[2]
    return np.column_stack([columns[:, k:] @ x[k:] for columns, x in _each(gravity, motion)])


def residual_torque(gravity: FloatArray, motion: Motion) -> FloatArray:
    """Return the residual (M, N) in N·m of gravity (M, N, K) and nuisance terms."""
    explained = np.column_stack([columns @ x for columns, x in _each(gravity, motion)])
    return np.asarray(motion.samples.tau - explained)


def _each(gravity: FloatArray, motion: Motion) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the columns of each joint, those of gravity first, and their coefficients."""
    for joint, tau in enumerate(motion.samples.tau.T):
        columns = np.column_stack([gravity[:, joint], nuisance(motion, joint)])
        yield columns, lstsq(columns, tau, rcond=1e-10)
