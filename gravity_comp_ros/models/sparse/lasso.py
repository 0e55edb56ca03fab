"""
The L1 problem over all 3^N features, solved on a small working set.

    minimise  1/2 |A x - b|^2 + lambda sum_k s_k |x_k|        (Yu 2022, Eqs. 8-9)

s_k is the length of column k, so lambda is in units of the noise when the rows of A and b are
divided by its standard deviation. ADMM solves the problem on the working set. The optimality
conditions are then checked over all 3^N columns, by products that never build them, and violators
join the working set. The certificate of a solution is computed from the problem, independently of
the solver.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.models.sparse import admm
from gravity_comp_ros.models.sparse.regressor import Design
import numpy as np

# Number of violators that join the working set in one round: few at first, as ADMM's cost grows
# with the set, and more in a large set, so that many features need few rounds.
_BATCH, _LARGE_BATCH, _SHARE = 10, 40, 0.1
_MAX_ROUNDS = 100
# Length below which, relative to the longest, a column is a structural 0 up to rounding.
_NEGLIGIBLE = 1e-9


def column_lengths(design: Design) -> FloatArray:
    """Return the length of every column of a design."""
    return np.sqrt(np.maximum(design.squared_norms, 0.0))


def has_length(lengths: FloatArray) -> BoolArray:
    """Return the mask of the columns that are not a structural 0 up to rounding."""
    return lengths > _NEGLIGIBLE * max(float(lengths.max(initial=0.0)), 1e-300)


@dataclass(frozen=True)
class Certificate:
    """
    Optimality of a solution, computed from the problem over all columns of unit length.

    `gap` is the duality gap relative to the primal objective; `violation` the largest violation of
    the optimality conditions relative to lambda. The residuals are those of the split x = z
    at the final point: with y = A.T (b - A x), for which Eq. (12) yields x again, Eq. (13) yields
    z = S_lambda(x + y), and `primal_residual` is |x - z|; `dual_residual` is the largest distance
    of y from lambda times the subdifferential of |x|.
    """

    objective: float
    dual_objective: float
    gap: float
    violation: float
    primal_residual: float
    dual_residual: float


@dataclass(frozen=True, eq=False)
class LassoSolution:
    """Non-zero coefficients x of features `indices`, for one lambda."""

    lam: float
    indices: IntArray
    x: FloatArray
    iterations: int
    rounds: int
    working_set: int
    converged: bool
    certificate: Certificate


@dataclass(eq=False)
class LassoProblem:
    """
    An L1 problem; its solutions share the working set and its Gram matrix.

    :param design: A, weighted rows.
    :param b: right-hand side (R,), with the same weights.
    :param usable: mask over all columns; the coefficients of the others, and of columns of
        length 0, are 0.
    """

    design: Design
    b: FloatArray
    usable: BoolArray
    options: admm.AdmmOptions = admm.AdmmOptions()

    def __post_init__(self) -> None:
        lengths = column_lengths(self.design)
        usable = self.usable & has_length(lengths)
        self._inverse_lengths = np.where(usable, 1.0 / np.where(usable, lengths, 1.0), 0.0)
        self._c = self.design.correlate(self.b) * self._inverse_lengths
        self._correlation = self._c
        self._set = np.zeros(0, dtype=np.int64)
        self._columns = np.zeros((0, self.design.n_rows))
        self._gram = np.zeros((0, 0))
        self._state = admm.AdmmState(np.zeros(0), np.zeros(0), self.options.rho)

    def solve(self, lam: float) -> LassoSolution:
        """Return the solution for `lam` > 0, started from the previous one."""
        return self._solution(lam, *self._run(lam))

    def _run(self, lam: float) -> tuple[admm.AdmmResult, int, int]:
        """Solve on the working set and enlarge it until no column violates the conditions."""
        iterations, rounds = 0, 0
        # The residual of the previous lambda determines the first violators.
        self._take_violators(lam)
        while True:
            rounds += 1
            inner = admm.solve(self._gram, self._c[self._set], np.full(len(self._set), lam),
                               self._state, self.options)
            self._state = inner.state
            iterations += inner.iterations
            self._correlation = self._residual_correlation(inner.state.z)
            if (not inner.converged or rounds == _MAX_ROUNDS
                    or not self._take_violators(lam)):
                return inner, iterations, rounds

    def _take_violators(self, lam: float) -> bool:
        """Enlarge the working set by the worst violators; return whether there were any."""
        excess = np.abs(self._correlation) - lam
        excess[self._set] = -np.inf
        violators = np.flatnonzero(excess > self.options.tolerance * lam)
        count = int(np.clip(_SHARE * len(self._set), _BATCH, _LARGE_BATCH))
        worst = violators[np.argsort(-excess[violators], kind='stable')[:count]]
        if worst.size:
            self._enlarge(worst, self._correlation[worst])
        return bool(worst.size)

    def _residual_correlation(self, z: FloatArray) -> FloatArray:
        active = np.flatnonzero(z)
        residual = self.b - z[active] @ self._columns[active]
        return self.design.correlate(residual) * self._inverse_lengths

    def _enlarge(self, new: IntArray, correlation: FloatArray) -> None:
        """Add columns."""
        added = (self.design.columns(new) * self._inverse_lengths[new]).T
        cross = self._columns @ added.T
        self._gram = np.block([[self._gram, cross], [cross.T, added @ added.T]])
        self._columns = np.concatenate([self._columns, added])
        self._set = np.concatenate([self._set, new])
        state = self._state
        self._state = admm.AdmmState(np.concatenate([state.z, np.zeros(len(new))]),
                                     np.concatenate([state.y, correlation / state.rho]),
                                     state.rho)

    def _solution(self, lam: float, inner: admm.AdmmResult, iterations: int,
                  rounds: int) -> LassoSolution:
        z = inner.state.z
        active = np.flatnonzero(z)
        order = active[np.argsort(self._set[active])]
        indices = self._set[order]
        certificate = self._certify(indices, z[order], lam)
        return LassoSolution(lam, indices, z[order] * self._inverse_lengths[indices],
                             iterations, rounds, len(self._set),
                             certificate.violation <= self.options.tolerance, certificate)

    def _certify(self, indices: IntArray, z: FloatArray, lam: float) -> Certificate:
        """Return the certificate, computed from A, b and z only."""
        unit_columns = self.design.columns(indices) * self._inverse_lengths[indices]
        residual = self.b - unit_columns @ z
        correlation = self.design.correlate(residual) * self._inverse_lengths
        full = np.zeros(self.design.n_columns)
        full[indices] = z
        objective = 0.5 * float(residual @ residual) + lam * float(np.abs(z).sum())
        steepest = float(np.abs(correlation).max(initial=0.0))
        dual_point = residual * min(1.0, lam / max(steepest, 1e-300))
        dual = float(dual_point @ self.b - 0.5 * dual_point @ dual_point)
        violation = admm.violation(full, -correlation, np.full(len(full), lam))
        split = float(np.linalg.norm(full - admm.soft_threshold(full + correlation, lam)))
        return Certificate(objective, dual, (objective - dual) / max(objective, 1e-300),
                           violation, split, violation * lam)
