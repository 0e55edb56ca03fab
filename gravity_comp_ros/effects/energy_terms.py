"""
Torques derived from parts of the gravity model's energy.

The energy of a serial arm is U = sum_i w_i . h_i, where w_i is the direction of gravity in the
frame of link i and h_i a first moment (Yu 2022, Eq. (3)). The features of U whose last joint is
n are w_n . h_n, so they describe the rotation of gravity's direction by the joints without any
kinematics. Derivatives of such parts are other components of the same w_n. All results remain
in the dictionary, so they and their derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.least_squares import svd
from gravity_comp_ros.models.sparse import dictionary
from gravity_comp_ros.models.sparse.expansion import Expansion
import numpy as np

_CHUNK = 4096


def by_last_joint(energy: Expansion, n_joints: int) -> dict[int, Expansion]:
    """Return the energy split by the last joint of each feature, without constants."""
    factors = dictionary.digits(energy.indices, n_joints) != dictionary.ONE
    last = np.where(factors.any(axis=1), n_joints - 1 - factors[:, ::-1].argmax(axis=1), -1)
    return {int(joint): Expansion(energy.indices[last == joint], energy.weights[last == joint])
            for joint in np.unique(last) if joint >= 0}


def lateral(part: Expansion, n_joints: int, joint: int, turning: int) -> Expansion | None:
    """
    Return the component of gravity's direction along the axis of `joint`.

    If the axis of `turning` is perpendicular to that of `joint`, part = c P + s Q, with s and c
    the sine and cosine of q_joint from a zero angle. P is along the axis of `turning` and does
    not depend on it; Q is rotated by it into the component along the axis of `joint`:
    -dQ/dq_turning. The zero angle follows from the derivative, in which the factors of sine and
    cosine of q_joint are proportional. The sign is undetermined: an arm and its mirror image
    have the same energy.

    :return: None if the factors are not proportional: the axes are not perpendicular.
    """
    slope = part.gradient(n_joints, turning)
    halves = [_without(slope, n_joints, joint, factor)
              for factor in (dictionary.SIN, dictionary.COS)]
    features = np.unique(np.concatenate([half.indices for half in halves]))
    weights = np.zeros((2, len(features)))
    for row, half in zip(weights, halves):
        row[np.searchsorted(features, half.indices)] = half.weights
    if not weights.any():
        return None
    left, size, right = svd(weights)
    if len(size) > 1 and size[1] > 0.2 * size[0]:
        return None
    # The sign is that of the larger half, so that it does not depend on the decomposition.
    sign = 1.0 if left[np.argmax(np.abs(left[:, 0])), 0] > 0 else -1.0
    return pruned(Expansion(features, sign * size[0] * right[0]))


def times(part: Expansion, n_joints: int, joint: int, factor: int) -> Expansion:
    """Return a part without `joint` times the factor (SIN or COS) of that joint."""
    moved = part.indices + factor * 3 ** (n_joints - 1 - joint)
    order = np.argsort(moved)
    return Expansion(moved[order], part.weights[order])


def pruned(part: Expansion) -> Expansion:
    """Return a part without terms of zero weight."""
    keep = part.weights != 0.0
    return Expansion(part.indices[keep], part.weights[keep])


def evaluate(parts: Sequence[Expansion], q: FloatArray) -> FloatArray:
    """Return the values (M, K) of K parts at poses q (M, N)."""
    features: IntArray = np.unique(np.concatenate(
        [np.zeros(0, dtype=np.int64), *(part.indices for part in parts)]))
    weights = np.zeros((len(features), len(parts)))
    for k, part in enumerate(parts):
        weights[np.searchsorted(features, part.indices), k] = part.weights
    out = np.zeros((len(q), len(parts)))
    for start in range(0, len(q) if len(features) else 0, _CHUNK):
        rows = slice(start, start + _CHUNK)
        out[rows] = dictionary.columns(q[rows], features) @ weights
    return out


def torques(parts: Sequence[Expansion], q: FloatArray) -> FloatArray:
    """Return the torque (M, N, K) of K energies at poses q (M, N): their gradients."""
    n = q.shape[1]
    slopes = [part.gradient(n, joint) for joint in range(n) for part in parts]
    return evaluate(slopes, q).reshape(len(q), n, len(parts))


def _without(part: Expansion, n_joints: int, joint: int, factor: int) -> Expansion:
    """Return the terms with that factor of a joint, divided by the factor."""
    here = dictionary.digits(part.indices, n_joints)[:, joint] == factor
    return Expansion(part.indices[here] - factor * 3 ** (n_joints - 1 - joint),
                     part.weights[here])


def total(parts: Sequence[Expansion]) -> Expansion:
    """Return the sum of parts."""
    features = np.unique(np.concatenate([part.indices for part in parts]))
    weights = np.zeros(len(features))
    for part in parts:
        weights[np.searchsorted(features, part.indices)] += part.weights
    return Expansion(features, weights)
