"""
Regressor matrices over the dictionary that are used without being built.

A design is a matrix A with one column per feature and weighted rows. The solver needs three
things of it: chosen columns, A.T r over all columns, and the squared length of every column.
"""

from __future__ import annotations

from typing import Protocol

from gravity_comp_ros.gravity import dictionary
from gravity_comp_ros.samples import FloatArray, IntArray
import numpy as np


class Design(Protocol):
    """A matrix with R rows and 3^N columns, in the form that the working-set solver needs."""

    n_rows: int
    n_columns: int

    def columns(self, indices: IntArray) -> FloatArray:
        """Return the chosen columns, shape (R, K)."""

    def correlate(self, r: FloatArray) -> FloatArray:
        """Return A.T r for r (R,), over all columns."""

    def squared_norms(self) -> FloatArray:
        """Return the squared length of every column."""


class TorqueDesign:
    """
    The features of one joint's torque: A = diag(w) F (Yu 2022, Eqs. 5-7).

    :param q: joint positions (M, N), rad.
    :param row_weights: w (M, 1), one over the standard deviation of the joint's noise.
    """

    def __init__(self, q: FloatArray, row_weights: FloatArray) -> None:
        self.q = q
        self.row_weights = row_weights[:, 0]
        self.n_rows = q.shape[0]
        self.n_columns = dictionary.n_features(q.shape[1])
        self._halves = dictionary.Halves(q)

    def columns(self, indices: IntArray) -> FloatArray:
        return self.row_weights[:, None] * dictionary.columns(self.q, indices)

    def correlate(self, r: FloatArray) -> FloatArray:
        return self._halves.correlate(self.row_weights * r)

    def squared_norms(self) -> FloatArray:
        return self._halves.correlate_squares(self.row_weights ** 2)


class EnergyDesign:
    """
    The gradient of the features of ONE potential energy, for all joints together.

    With U = sum_k theta_k phi_k(q) the torque of joint n is sum_k theta_k d phi_k / d q_n. Rows
    are the samples of joint 1, then those of joint 2, and so on: R = N M.

    :param q: joint positions (M, N), rad.
    :param row_weights: w (M, N), one over the standard deviation of each joint's noise.
    """

    def __init__(self, q: FloatArray, row_weights: FloatArray) -> None:
        self.q = q
        self.row_weights = row_weights
        self.n_joints = q.shape[1]
        self.n_rows = q.size
        self.n_columns = dictionary.n_features(self.n_joints)
        self._halves = dictionary.Halves(q)

    def columns(self, indices: IntArray) -> FloatArray:
        blocks = []
        for n in range(self.n_joints):
            features, signs = dictionary.derivative(indices, self.n_joints, n)
            block = np.zeros((self.q.shape[0], len(features)))
            present = signs != 0.0
            block[:, present] = (dictionary.columns(self.q, features[present])
                                 * signs[present] * self.row_weights[:, n, None])
            blocks.append(block)
        return np.concatenate(blocks)

    def correlate(self, r: FloatArray) -> FloatArray:
        total = np.zeros(self.n_columns)
        for n, part in enumerate(r.reshape(self.n_joints, -1)):
            products = self._halves.correlate(self.row_weights[:, n] * part)
            self._add_swapped(total, products, n, sign_of_cosine=-1.0)
        return total

    def squared_norms(self) -> FloatArray:
        total = np.zeros(self.n_columns)
        for n in range(self.n_joints):
            squares = self._halves.correlate_squares(self.row_weights[:, n] ** 2)
            self._add_swapped(total, squares, n, sign_of_cosine=1.0)
        return total

    def _add_swapped(self, total: FloatArray, products: FloatArray, joint: int,
                     sign_of_cosine: float) -> None:
        """Add what F yields for joint `joint` where its derivative puts it (`derivative`)."""
        shape = (3 ** joint, 3, -1)
        target, source = total.reshape(shape), products.reshape(shape)
        target[:, dictionary.SIN] += source[:, dictionary.COS]
        target[:, dictionary.COS] += sign_of_cosine * source[:, dictionary.SIN]
