"""
Whitening of a design against nuisance columns, with free coefficients or a Gaussian prior.

With coefficients c ~ N(0, S^2) of nuisance columns Z (rows in units of the noise), the torque has
the covariance I + Z S^2 Z.T. Both sides of the least squares of Yu 2022, Eq. (8) are whitened,

    |P A x - P b|^2,    P = I - Q D Q.T,    D = 1 - (1 + l)^(-1/2),

where Z S = Q l^(1/2) V.T. For a free coefficient l is infinite and P the projection on the
orthogonal complement of Z (Frisch and Waugh 1933). So every L1 problem, its optimality conditions
and its certificate hold for P A and P b. Friction or an offset cannot enter the support as
features of gravity, nor is gravity absorbed by an offset where little motion distinguishes them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.models.least_squares import lstsq, svd
from gravity_comp_ros.models.sparse.regressor import Design
import numpy as np

# Singular values of the nuisance columns below this share of the largest are rounding errors.
_RANK = 1e-9


def orthonormal_basis(columns: FloatArray) -> FloatArray:
    """
    Return an orthonormal basis (R, K') of the span of columns (R, K).

    Columns are scaled to unit length first, so that the rank does not depend on their units.
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
    The span of nuisance columns: orthonormal `directions` Q (R, K'), and `share` (K',) in 0 to 1.

    The share l / (1 + l) is the part of a direction that the nuisance terms absorb; 1 where they
    are free.
    """

    directions: FloatArray
    share: FloatArray

    @classmethod
    def of(cls, columns: FloatArray, spread: FloatArray | None = None) -> NuisanceBasis:
        """
        Return the basis of columns (R, K) in units of the noise.

        :param spread: prior standard deviations (K,) of the coefficients, infinite where they are
            free; None if all are free.
        """
        if spread is None:
            free = orthonormal_basis(columns)
            return cls(free, np.ones(free.shape[1]))
        is_free = ~np.isfinite(spread)
        free = orthonormal_basis(columns[:, is_free])
        others = columns[:, ~is_free] * spread[~is_free]
        others = others - free @ (free.T @ others)
        u, s, _ = svd(others)
        kept = s > _RANK * max(float(s.max(initial=0.0)), 1e-300)
        power = s[kept] ** 2
        return cls(np.hstack([free, u[:, kept]]),
                   np.concatenate([np.ones(free.shape[1]), power / (1.0 + power)]))

    @cached_property
    def inside(self) -> FloatArray:
        """Return B (R, K') with P P = I - B B.T."""
        return np.asarray(self.directions * np.sqrt(self.share))

    @cached_property
    def _d(self) -> FloatArray:
        """Return the diagonal (K', 1) of D."""
        return np.asarray((1.0 - np.sqrt(1.0 - self.share))[:, None])

    def project(self, r: FloatArray) -> FloatArray:
        """Return P r for r (R,) or (R, K)."""
        inner = self.directions.T @ r
        d = self._d if inner.ndim > 1 else self._d[:, 0]
        return np.asarray(r - self.directions @ (d * inner))


def scaled_spread(spread: FloatArray | None, plain: FloatArray, weighted: FloatArray
                  ) -> FloatArray | None:
    """
    Return the prior standard deviations (K,) of coefficients.

    They are given per N·m of noise and scale with the noise of the fit: a noise that is
    overestimated, by the first guess or an unmodelled effect, must not suppress friction.

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
    """Return the most probable coefficients (K,) of columns (R, K) for a target (R,)."""
    if spread is None:
        return np.asarray(lstsq(columns, target, rcond=1e-9))
    # The prior of each coefficient is an additional row.
    rows = np.concatenate([columns, np.diag(1.0 / spread)])
    lengths = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    target = np.concatenate([target, np.zeros(len(spread))])
    return np.asarray(lstsq(rows / lengths, target, rcond=1e-9) / lengths)


class ProjectedDesign:
    """The design P A of a design A and a basis of nuisance columns, with the same row weights."""

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
        """Return the reweighted A; the nuisance columns must be reweighted by the caller."""
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
        remaining = total - absorbed
        # Columns within the span of the nuisance columns have length 0 up to rounding.
        return np.where(remaining > 1e-10 * total, remaining, 0.0)
