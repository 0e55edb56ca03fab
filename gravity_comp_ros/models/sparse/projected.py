"""
A design beside nuisance columns, whose coefficients are free or known to be near 0.

With coefficients c ~ N(0, S^2) of nuisance columns Z (rows in units of the noise), the torque has
the covariance I + Z S^2 Z.T. Both sides of the least squares of Yu 2022, Eq. (8) are whitened,

    |P A x - P b|^2,    P = I - Q D Q.T,    D = 1 - (1 + l)^(-1/2),

where Z S = Q l^(1/2) V.T. For a free coefficient l is infinite and P the projection on the
orthogonal complement of Z (Frisch and Waugh 1933). So every L1 problem, its optimality conditions
and its certificate hold for P A and P b, and friction or an offset cannot enter the support as
features of gravity; nor can gravity hide in an offset where little motion tells them apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.least_squares import lstsq, svd
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
    u, s, _ = svd(columns[:, kept] / lengths[kept])
    return np.ascontiguousarray(u[:, s > _RANK * s[0]])


@dataclass(frozen=True, eq=False)
class NuisanceBasis:
    """
    What nuisance columns span: orthonormal `directions` Q (R, K'), and `share` (K',) in 0 to 1.

    The share l / (1 + l) says how much of a direction the nuisance terms take; 1 where they are
    free.
    """

    directions: FloatArray
    share: FloatArray

    @classmethod
    def of(cls, columns: FloatArray, spread: FloatArray | None = None) -> NuisanceBasis:
        """
        Return the basis of columns (R, K) in units of the noise.

        :param spread: standard deviations (K,) of the coefficients before any data, infinite
            where they are free; None if all are.
        """
        if spread is None:
            free = orthonormal_basis(columns)
            return cls(free, np.ones(free.shape[1]))
        loose = ~np.isfinite(spread)
        free = orthonormal_basis(columns[:, loose])
        rest = columns[:, ~loose] * spread[~loose]
        rest = rest - free @ (free.T @ rest)
        u, s, _ = svd(rest)
        kept = s > _RANK * max(float(s.max(initial=0.0)), 1e-300)
        power = s[kept] ** 2
        return cls(np.hstack([free, u[:, kept]]),
                   np.concatenate([np.ones(free.shape[1]), power / (1.0 + power)]))

    @cached_property
    def inside(self) -> FloatArray:
        """Return B (R, K') with P P = I - B B.T."""
        return np.asarray(self.directions * np.sqrt(self.share))

    @cached_property
    def _taken(self) -> FloatArray:
        return np.asarray((1.0 - np.sqrt(1.0 - self.share))[:, None])

    def project(self, r: FloatArray) -> FloatArray:
        """Return P r for r (R,) or (R, K)."""
        inner = self.directions.T @ r
        taken = self._taken if inner.ndim > 1 else self._taken[:, 0]
        return np.asarray(r - self.directions @ (taken * inner))


def scaled_spread(spread: FloatArray | None, plain: FloatArray, weighted: FloatArray
                  ) -> FloatArray | None:
    """
    Return the standard deviations (K,) that coefficients have before any data.

    They are given per N·m of noise, so that they widen with the noise that a fit works with: what
    a first guess of the noise is too large by, or what an unmodelled effect adds to it, must not
    turn friction into noise.

    :param spread: (K,), per N·m of noise; None where all coefficients are free.
    :param plain: columns (R, K) in N·m per unit of coefficient; `weighted` the same in units of
        the noise.
    """
    if spread is None:
        return None
    lengths = np.maximum(np.linalg.norm(weighted, axis=0), 1e-300)
    return np.asarray(spread * np.linalg.norm(plain, axis=0) / lengths)


def nuisance_coefficients(columns: FloatArray, target: FloatArray,
                          spread: FloatArray | None = None) -> FloatArray:
    """Return the likeliest coefficients (K,) of columns (R, K) that explain a target (R,)."""
    if spread is None:
        return np.asarray(lstsq(columns, target, rcond=1e-9))
    # The prior of each coefficient is a row of its own.
    rows = np.concatenate([columns, np.diag(1.0 / spread)])
    lengths = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    target = np.concatenate([target, np.zeros(len(spread))])
    return np.asarray(lstsq(rows / lengths, target, rcond=1e-9) / lengths)


class ProjectedDesign:
    """The design P A of a design A and a basis of nuisance columns, rows weighted alike."""

    def __init__(self, design: Design, basis: NuisanceBasis) -> None:
        self.design = design
        self.n_rows, self.n_columns = design.n_rows, design.n_columns
        self._basis = basis

    def project(self, r: FloatArray) -> FloatArray:
        """Return P r for r (R,) or (R, K)."""
        return self._basis.project(r)

    @property
    def precise(self) -> Design:
        exact = self.design.precise
        return self if exact is self.design else ProjectedDesign(exact, self._basis)

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
        """Return |P a|^2 = |a|^2 - |B.T a|^2 of every column a."""
        total = self.design.squared_norms()
        absorbed = (self.design.precise.correlate_many(self._basis.inside) ** 2).sum(axis=0)
        left = total - absorbed
        # What rounding leaves of a column that the nuisance columns span has no length.
        return np.where(left > 1e-10 * total, left, 0.0)
