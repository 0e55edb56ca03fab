"""Vectors of the links at B states, (..., xyz, B): products, and sums over the joints."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
import numpy as np


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the scalar products over the last axis but one, (..., B)."""
    return np.asarray(a[..., 0, :] * b[..., 0, :] + a[..., 1, :] * b[..., 1, :]
                      + a[..., 2, :] * b[..., 2, :])


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products over the last axis but one, (..., xyz, B)."""
    result = np.empty(np.broadcast(a, b).shape)
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        np.subtract(a[..., i, :] * b[..., j, :], a[..., j, :] * b[..., i, :],
                    out=result[..., k, :])
    return result


def outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a b', (N, 3, 3, B), of vectors (N, 3, B)."""
    return np.asarray(a[:, :, None] * b[:, None])


def times(matrices: FloatArray, v: FloatArray) -> FloatArray:
    """Return matrices (..., 3, 3, B) times vectors (..., 3, B)."""
    return np.asarray((matrices * v[..., None, :, :]).sum(axis=-2))


def cross_matrices(v: FloatArray) -> FloatArray:
    """Return the matrices (N, 3, 3, B) of v x for v (N, 3, B)."""
    matrices = np.zeros((len(v), 3, 3, v.shape[-1]))
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        matrices[:, j, i], matrices[:, i, j] = v[:, k], -v[:, k]
    return matrices


def next_values(values: FloatArray) -> FloatArray:
    """Return the values of the next joint, 0 for the last."""
    return np.concatenate([values[1:], np.zeros_like(values[:1])])


def prefix_sums(values: FloatArray) -> FloatArray:
    """Return the sums over all joints before each."""
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(values[:-1], axis=0)])


def suffix_sums(values: FloatArray) -> FloatArray:
    """Return the sums over each joint and all beyond it."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def combined(axes: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the sums (K, xyz, B) of the axes (K, A, xyz, B) with weights (K, A) or (K, A, B)."""
    weights = weights[..., None] if weights.ndim == 2 else weights
    return np.asarray(sum(weights[:, k, None] * axes[:, k] for k in range(axes.shape[1])))
