"""
Regressor matrices over the dictionary, used without being built.

A design is a matrix A with one column per feature and weighted rows. The solver requires selected
columns, A.T r over all columns for one r or several, and the squared length of every column.
Quantities that depend on the poses only are computed once and shared by all `reweighted` designs:
the noise, and with it the weights, are estimated again in every round of a fit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.sparse import dictionary
import numpy as np


class Design(ABC):
    """
    A matrix with R rows and 3^N columns.

    :param q: joint positions (M, N), rad.
    :param row_weights: (M, J), one over the standard deviation of each of J torques: R = J M.
    """

    def __init__(self, q: FloatArray, row_weights: FloatArray,
                 halves: dictionary.Halves | None = None) -> None:
        self.q, self.row_weights = q, row_weights
        self.n_rows = row_weights.size
        self.n_columns = dictionary.n_features(q.shape[1])
        self.halves = halves or dictionary.Halves(q)

    @abstractmethod
    def columns(self, indices: IntArray) -> FloatArray:
        """Return selected columns, shape (R, K)."""

    @abstractmethod
    def correlate(self, r: FloatArray) -> FloatArray:
        """Return A.T r for r (R,), over all columns."""

    @cached_property
    @abstractmethod
    def squared_norms(self) -> FloatArray:
        """The squared length of every column."""

    def correlate_many(self, r: FloatArray) -> FloatArray:
        """Return r.T A for r (R, K), shape (K, 3^N)."""
        return np.array([self.correlate(one) for one in r.T]).reshape(-1, self.n_columns)

    def reweighted(self, row_weights: FloatArray) -> Design:
        """Return the design of the same poses with other weights of the rows."""
        return type(self)(self.q, row_weights, self.halves)


class TorqueDesign(Design):
    """The features of one joint's torque, J = 1: A = diag(w) F (Yu 2022, Eqs. 5-7)."""

    def columns(self, indices: IntArray) -> FloatArray:
        return (self.halves.columns(indices) * self.row_weights[:, 0]).T

    def correlate(self, r: FloatArray) -> FloatArray:
        return self.halves.correlate(self.row_weights[:, 0] * r)

    @cached_property
    def squared_norms(self) -> FloatArray:
        return self.halves.correlate_squares(self.row_weights[:, 0] ** 2)


class EnergyDesign(Design):
    """
    The gradient of the features of one potential energy, for all joints together, J = N.

    With U = sum_k theta_k phi_k(q) the torque of joint n is sum_k theta_k d phi_k / d q_n. Rows
    are the samples of joint 1, then those of joint 2, and so on: R = N M.

    A joint of the first half changes only L, one of the second only R. So the rows of the joints
    of a half are summed before the large product,

        A.T r = vec(L1.T R + L.T R1),    L1 = sum_n diag(r_n) dL/dq_n over the first half,

    and R1 likewise over the second: two products for any number of joints.
    """

    def columns(self, indices: IntArray) -> FloatArray:
        columns = np.zeros((len(indices), self.q.shape[1], len(self.q)))
        for n in range(self.q.shape[1]):
            features, signs = dictionary.derivative(indices, self.q.shape[1], n)
            present = np.flatnonzero(signs)
            columns[present, n] = (self.halves.columns(features[present])
                                   * (signs[present, None] * self.row_weights[:, n]))
        return columns.reshape(len(indices), self.n_rows).T

    def correlate(self, r: FloatArray) -> FloatArray:
        halves, weighted = self.halves, r.reshape(self.q.shape[1], -1) * self.row_weights.T
        left, right, scratch = halves.scratch
        left[:] = 0.0
        right[:] = 0.0
        for n in np.flatnonzero(weighted.any(axis=1)).tolist():
            target = _of_joint(left, right, halves.n_left, n)
            source = _of_joint(halves.left, halves.right, halves.n_left, n)
            product = scratch[:len(target) * target.shape[2]].reshape(target[:, 0].shape)
            np.multiply(source[:, dictionary.COS], weighted[n], out=product)
            target[:, dictionary.SIN] += product
            np.multiply(source[:, dictionary.SIN], weighted[n], out=product)
            target[:, dictionary.COS] -= product
        return (left @ halves.right.T + halves.left @ right.T).ravel()

    @cached_property
    def squared_norms(self) -> FloatArray:
        halves, weights = self.halves, self.row_weights.T ** 2
        left, right = np.zeros_like(halves.left), np.zeros_like(halves.right)
        squares = halves.left ** 2, halves.right ** 2
        for n in range(self.q.shape[1]):
            target = _of_joint(left, right, halves.n_left, n)
            source = _of_joint(*squares, halves.n_left, n)
            target[:, dictionary.SIN] += source[:, dictionary.COS] * weights[n]
            target[:, dictionary.COS] += source[:, dictionary.SIN] * weights[n]
        return (left @ squares[1].T + squares[0] @ right.T).ravel()


def _of_joint(left: FloatArray, right: FloatArray, n_left: int, joint: int) -> FloatArray:
    """Return a view (before, 3, after, M) of a joint's half; axis 1 is the joint's factor."""
    half, place = (left, joint) if joint < n_left else (right, joint - n_left)
    return half.reshape(3 ** place, 3, -1, half.shape[1])
