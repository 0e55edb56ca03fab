"""
What moves and what rubs, taken off the torque before gravity is chosen.

A fit of gravity alone bends towards what is not gravity. Where nothing is known of the arm,
friction, an offset and a row of inertia of each joint are fitted beside it, each joint for itself.
(`effects.motion_fit` fits all joints together where axes are known.)
"""

from __future__ import annotations

from collections.abc import Iterator

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.nuisance import nuisance
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np


def beside(gravity: FloatArray, motion: Motion) -> FloatArray:
    """
    Return the torque (M, N) of friction, offset and inertia, each joint for itself.

    :param gravity: (M, N, K) columns of gravity to fit them beside.
    """
    k = gravity.shape[2]
    return np.column_stack([columns[:, k:] @ x[k:] for columns, x in _each(gravity, motion)])


def left_beside(gravity: FloatArray, motion: Motion) -> FloatArray:
    """Return what gravity (M, N, K), friction, offset and inertia leave of each joint, (M, N)."""
    explained = np.column_stack([columns @ x for columns, x in _each(gravity, motion)])
    return np.asarray(motion.samples.tau - explained)


def _each(gravity: FloatArray, motion: Motion) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Return the columns of each joint, those of gravity first, and their coefficients."""
    for joint, tau in enumerate(motion.samples.tau.T):
        columns = np.column_stack([gravity[:, joint], nuisance(motion, joint)])
        yield columns, lstsq(columns, tau, rcond=1e-10)
