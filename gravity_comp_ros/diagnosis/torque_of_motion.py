"""
What moves and what rubs, taken off the torque before gravity is chosen.

A fit of gravity alone bends towards what is not gravity. Where nothing is known of the arm,
friction, an offset and a row of inertia of each joint are fitted beside it. Where the axes are
known, the torque of motion is linear in the inertial parameters: one set of them serves all
joints, and the moments of fast motion are told from those of gravity.
"""

from __future__ import annotations

from collections.abc import Iterator

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.gravity_on_axes import independent
from gravity_comp_ros.diagnosis.nuisance import friction, nuisance
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.rigid_body import columns_of, dynamics_of
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# What is usual of gravity: tilts of the base in rad.
_TILT = 0.3
# Rounds in which joints get the weight of what is left on them.
_ROUNDS = 3


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
        yield columns, np.linalg.lstsq(columns, tau, rcond=1e-10)[0]


def beside_on_axes(gravity: FloatArray, motion: Motion, model: GravityModel) -> FloatArray:
    """
    Return the torque (M, N) of friction, offset and rigid-body dynamics, all joints together.

    :param gravity: (M, N, K) columns of gravity to fit them beside, as of `columns_on_axes`.
    :param model: with the axes and the first moments of the nominal arm.
    """
    samples, dynamics = motion.samples, dynamics_of(model)
    m, n = samples.q.shape
    k = gravity.shape[2]
    x = np.concatenate([gravity, columns_of(dynamics, samples.q, samples.qd, motion.qdd),
                        *(_on_joint(j, n, friction(motion, j)) for j in range(n))], axis=2)
    usual = np.full(x.shape[2], np.inf)
    usual[:2], usual[2:k] = _TILT, float(np.abs(samples.tau).max())
    usual[k:k + len(dynamics.usual)] = dynamics.usual
    ridge = np.diag(1.0 / usual) * np.sqrt(m / independent(samples))
    left = np.maximum(samples.tau.std(axis=0), 1e-9)
    for _ in range(_ROUNDS):
        weight = 1.0 / np.maximum(left, 1e-6 * left.max())
        rows = (x * weight[None, :, None]).reshape(m * n, -1)
        a = np.concatenate([rows, ridge])
        b = np.concatenate([(samples.tau * weight).ravel(), np.zeros(len(ridge))])
        size = np.maximum(np.sqrt((a ** 2).sum(axis=0)), 1e-12)
        found = np.linalg.lstsq(a / size, b, rcond=1e-10)[0] / size
        left = np.sqrt(((samples.tau - x @ found) ** 2).mean(axis=0))
    return np.asarray(x[:, :, k:] @ found[k:])


def _on_joint(joint: int, n: int, columns: FloatArray) -> FloatArray:
    """Return columns (M, K) of one joint among those of all, (M, N, K)."""
    whole = np.zeros((len(columns), n, columns.shape[1]))
    whole[:, joint] = columns
    return whole
