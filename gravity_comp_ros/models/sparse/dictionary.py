"""
The dictionary: all 3^N products of one factor {1, sin q_n, cos q_n} per joint.

Every entry of the gravity torque of a serial arm of N revolute joints lies in the span of these
products (Yu 2022, Property 1, Eqs. 3-4). A feature is identified by its index. The base-3 digits
of the index, joint 1 first, are the factors of the joints: 0 is 1, 1 is sin, 2 is cos.

The 3^N columns are never built. A feature row is the Kronecker product of the factors of the
first joints with those of the last, so with the halves L and R (Yu 2022, Eq. 6)

    F.T r = vec(L.T diag(r) R).

The sin and cos columns of a joint at rest are collinear with the constant. The features that
contain them are not selected, so that the solver does not distribute a weight among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.poses import batches
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.errors import DataError
import numpy as np

ONE, SIN, COS = 0, 1, 2
# 3^12 features are 4 MB a vector; each further joint triples every product.
MAX_JOINTS = 12
# Maximum joint travel, in rad, of a joint that counts as at rest (encoder noise, control jitter).
_AT_REST = 2e-3


def n_features(n_joints: int) -> int:
    """
    Return 3^N.

    :raises DataError: if N is not 1 to 12.
    """
    if not 1 <= n_joints <= MAX_JOINTS:
        raise DataError(f'{n_joints} joints; the dictionary takes 1 to {MAX_JOINTS}. Select '
                        f'the joints with gravity torque')
    return int(3 ** n_joints)


def digits(indices: IntArray, n_joints: int) -> IntArray:
    """Return the factor (ONE, SIN, COS) of each joint in each feature, shape (K, N)."""
    powers = 3 ** np.arange(n_joints - 1, -1, -1, dtype=np.int64)
    return (np.asarray(indices, dtype=np.int64)[:, None] // powers) % 3


def index_of(factors: IntArray) -> IntArray:
    """Return the indices of features given by their factors (K, N); the inverse of `digits`."""
    factors = np.asarray(factors, dtype=np.int64)
    powers = 3 ** np.arange(factors.shape[1] - 1, -1, -1, dtype=np.int64)
    return factors @ powers


def feature_name(index: int, n_joints: int) -> str:
    """Return a feature in the notation of Yu 2022, e.g. `s1 c2`; the constant is `1`."""
    return feature_names(np.array([index]), n_joints)[0]


def feature_names(indices: IntArray, n_joints: int) -> list[str]:
    """Return the names of several features."""
    return [' '.join([f'{"sc"[d - 1]}{n}' for n, d in enumerate(factors, 1) if d]) or '1'
            for factors in digits(indices, n_joints).tolist()]


def joint_factors(q: FloatArray) -> FloatArray:
    """Return [1, sin q_n, cos q_n] for q (M, N) in rad, shape (N, M, 3)."""
    factors = np.empty((q.shape[1], q.shape[0], 3))
    factors[..., ONE] = 1.0
    np.sin(q.T, out=factors[..., SIN])
    np.cos(q.T, out=factors[..., COS])
    return factors


def columns(q: FloatArray, indices: IntArray) -> FloatArray:
    """
    Return selected columns of the feature matrix F (Yu 2022, Eqs. 5-7).

    :param q: joint positions (M, N), rad.
    :param indices: K features.
    :return: shape (M, K).
    """
    product = np.empty((q.shape[0], len(indices)))
    for rows in batches(len(q)):
        product[rows] = Halves(q[rows]).columns(indices).T
    return product


def combined(q: FloatArray, indices: IntArray, weights: FloatArray) -> FloatArray:
    """
    Return weighted sums of features, (M, J), without the whole matrix in memory.

    :param q: joint positions (M, N), rad.
    :param weights: (K, J) of the K features of `indices`.
    """
    sums = np.empty((q.shape[0], weights.shape[1]))
    for rows in batches(len(q)):
        sums[rows] = (weights.T @ Halves(q[rows]).columns(indices)).T
    return sums


class Halves:
    """
    The row-wise Kronecker halves L (first joints) and R (last joints) of F for q (M, N).

    Both are stored transposed, `left` (3^n_left, M) and `right` (3^n_right, M), so that operations
    over samples run along contiguous memory.
    """

    def __init__(self, q: FloatArray) -> None:
        n_features(q.shape[1])
        factors = joint_factors(q).transpose(0, 2, 1)
        self.n_left = (q.shape[1] + 1) // 2
        self.n_right = q.shape[1] - self.n_left
        self.left = _kronecker(factors[:self.n_left], q.shape[0])
        self.right = _kronecker(factors[self.n_left:], q.shape[0])

    @cached_property
    def scratch(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Buffers for a modified L, a modified R, and a third of either; not thread-safe."""
        return np.empty_like(self.left), np.empty_like(self.right), np.empty(
            (len(self.left) // 3, self.left.shape[1]))

    def columns(self, indices: IntArray) -> FloatArray:
        """Return selected columns of F, transposed, shape (K, M)."""
        left, right = np.divmod(np.asarray(indices, dtype=np.int64), len(self.right))
        return self.left[left] * self.right[right]

    def correlate(self, r: FloatArray) -> FloatArray:
        """Return F.T r for r (M,), over all 3^N features."""
        product = np.multiply(r, self.right, out=self.scratch[1])
        return (self.left @ product.T).ravel()

    def correlate_squares(self, weights: FloatArray) -> FloatArray:
        """Return sum_m weights_m F_mk^2 for weights (M,), over all 3^N features."""
        return (self.left ** 2 @ (weights * self.right ** 2).T).ravel()


def derivative(indices: IntArray, n_joints: int, joint: int) -> tuple[IntArray, FloatArray]:
    """
    Return d phi_k / d q_joint as (feature, sign): the derivative is in the dictionary as well.

    sin becomes cos, cos becomes -sin, and a feature without the joint has sign 0.
    """
    indices = np.asarray(indices, dtype=np.int64)
    power = 3 ** (n_joints - 1 - joint)
    factor = (indices // power) % 3
    swapped = np.where(factor == SIN, indices + power,
                       np.where(factor == COS, indices - power, indices))
    return swapped, np.choose(factor, [0.0, 1.0, -1.0])


def _kronecker(factors: FloatArray, n_rows: int) -> FloatArray:
    product = np.ones((1, n_rows))
    for factor in factors:
        product = (product[:, None, :] * factor[None, :, :]).reshape(
            len(product) * len(factor), n_rows)
    return product


@dataclass(frozen=True, eq=False)
class Expansion:
    """A sparse sum over the dictionary: ascending feature `indices` (K,), `weights` (K,)."""

    indices: IntArray
    weights: FloatArray

    def __post_init__(self) -> None:
        indices = np.asarray(self.indices, dtype=np.int64)
        weights = np.asarray(self.weights, dtype=np.float64)
        if indices.ndim != 1 or indices.shape != weights.shape:
            raise DataError(f'expansion: {indices.shape} features with {weights.shape} weights')
        if np.any(np.diff(indices) <= 0) or np.any(indices < 0):
            raise DataError('expansion: features must be ascending and unique')
        if not np.isfinite(weights).all():
            raise DataError('expansion: a weight is not finite')
        object.__setattr__(self, 'indices', indices)
        object.__setattr__(self, 'weights', weights)

    def evaluate(self, q: FloatArray) -> FloatArray:
        """Return the sum (M,) at poses q (M, N) in rad."""
        return np.asarray(columns(q, self.indices) @ self.weights)

    def gradient(self, n_joints: int, joint: int) -> Expansion:
        """Return d/dq_joint of this sum, which is in the dictionary as well."""
        features, signs = derivative(self.indices, n_joints, joint)
        present = signs != 0.0
        order = np.argsort(features[present])
        return Expansion(features[present][order],
                         (self.weights[present] * signs[present])[order])


def torque_of(torques: Sequence[Expansion], q: FloatArray) -> FloatArray:
    """Return the torques (M, N) in N·m of one expansion per joint, at poses q (M, N) in rad."""
    return np.stack([torque.evaluate(q) for torque in torques], axis=1)


def at_rest(q: FloatArray) -> BoolArray:
    """Return the mask (N,) of the joints of q (M, N) in rad that are at rest."""
    return np.ptp(q, axis=0) < _AT_REST if len(q) else np.ones(q.shape[1], dtype=bool)


def usable_for_torque(q: FloatArray) -> BoolArray:
    """Return the mask of features without sin and cos of joints at rest, shape (3^N,)."""
    return _mask(q.shape[1], {n: {ONE} for n in np.flatnonzero(at_rest(q))})


def usable_for_energy(q: FloatArray) -> BoolArray:
    """
    Return the mask of features with an identifiable gradient, shape (3^N,).

    A joint at rest keeps the constant and the factor with the larger derivative at its position,
    which determines its own torque.
    """
    kept = {}
    for n in np.flatnonzero(at_rest(q)):
        position = float(q[:, n].mean())
        steeper = SIN if abs(np.cos(position)) >= abs(np.sin(position)) else COS
        kept[n] = {ONE, steeper}
    return _mask(q.shape[1], kept)


def _mask(n_joints: int, kept: dict) -> BoolArray:
    mask = np.ones((3,) * n_joints, dtype=bool)
    for joint, factors in kept.items():
        for factor in {ONE, SIN, COS} - factors:
            mask[(slice(None),) * int(joint) + (factor,)] = False
    return mask.ravel()
