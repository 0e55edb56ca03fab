"""
A design beside nuisance columns: both sides are projected on their orthogonal complement.

The least-squares part of Yu 2022, Eq. (8) with free coefficients c of nuisance columns Z,

    min over c of |A x + Z c - b|^2 = |P A x - P b|^2,    P = I - Q Q.T,    Q orthonormal, span Z,

so that every L1 problem, its optimality conditions and its certificate hold for P A and P b, and
friction or an offset cannot enter the support as features of gravity (Frisch and Waugh 1933).
"""

from __future__ import annotations

from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.sparse.regressor import Design
import numpy as np

# Directions of the nuisance columns shorter than this share of the longest are rounding.
_RANK = 1e-9


def orthonormal_basis(columns: FloatArray) -> FloatArray:
    """
    Return an orthonormal basis (R, K') of the span of columns (R, K).

    Columns are scaled to unit length first, so that their units do not decide the rank.
    """
    lengths = np.linalg.norm(columns, axis=0)
    kept = lengths > 0.0
    if not kept.any():
        return np.zeros((len(columns), 0))
    u, s, _ = np.linalg.svd(columns[:, kept] / lengths[kept], full_matrices=False)
    return np.ascontiguousarray(u[:, s > _RANK * s[0]])


class ProjectedDesign:
    """
    The design P A of a design A and a basis of the nuisance columns (`orthonormal_basis`).

    :param design: A, weighted rows.
    :param nuisance: Z (R, K), rows weighted alike.
    """

    def __init__(self, design: Design, nuisance: FloatArray) -> None:
        self.design = design
        self.n_rows, self.n_columns = design.n_rows, design.n_columns
        self._basis = orthonormal_basis(nuisance)

    def project(self, r: FloatArray) -> FloatArray:
        """Return P r for r (R,) or (R, K)."""
        return np.asarray(r - self._basis @ (self._basis.T @ r))

    @property
    def precise(self) -> Design:
        exact = self.design.precise
        return self if exact is self.design else _with_basis(exact, self._basis)

    def reweighted(self, row_weights: FloatArray) -> Design:
        """Return the plain design with other weights: its nuisance columns must be given anew."""
        return self.design.reweighted(row_weights)

    def columns(self, indices: IntArray) -> FloatArray:
        return self.project(self.design.columns(indices))

    def correlate(self, r: FloatArray) -> FloatArray:
        return self.design.correlate(self.project(r))

    def correlate_many(self, r: FloatArray) -> FloatArray:
        return self.design.correlate_many(self.project(r))

    def squared_norms(self) -> FloatArray:
        return self._squared_norms

    @cached_property
    def _squared_norms(self) -> FloatArray:
        """Return |P a|^2 = |a|^2 - |Q.T a|^2 of every column a."""
        total = self.design.squared_norms()
        absorbed = (self.design.precise.correlate_many(self._basis) ** 2).sum(axis=0)
        left = total - absorbed
        # What rounding leaves of a column that the nuisance columns span has no length.
        return np.where(left > 1e-10 * total, left, 0.0)


def _with_basis(design: Design, basis: FloatArray) -> ProjectedDesign:
    other = ProjectedDesign(design, np.zeros((design.n_rows, 0)))
    other._basis = basis
    return other
