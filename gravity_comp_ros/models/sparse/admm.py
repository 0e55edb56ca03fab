"""
ADMM for the L1 problem on a few columns, from their Gram matrix.

    minimise  1/2 x.T G x - c.T x + sum_k lambda_k |x_k|            (Yu 2022, Eqs. 8-9)

with G = A.T A and c = A.T b. The splitting x = z, the linear step, the soft threshold and the
dual update are Yu 2022, Eqs. 10-14; over-relaxation and the balancing of rho follow Boyd et al.,
Distributed Optimization and Statistical Learning via ADMM (2011), sections 3.4.1 and 3.4.3.
ADMM finds the support fast and converges slowly in the last digits. So the final step is a polish:
solve on the support with its signs, and accept the result if it satisfies the optimality
conditions.
"""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.option_checks import check_positive
from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray
from gravity_comp_ros.errors import FitError, OptionError
import numpy as np
from scipy import linalg

# Eigenvalues of the Gram matrix below this share of the largest are rounding errors.
_DEPENDENT = 1e-13
# Iteration of the first polish.
_FIRST_POLISH = 5
# Distance of a point that is certain to change a sign, as a multiple of the largest coefficient.
_FAR = 1e3


@dataclass(frozen=True)
class AdmmOptions:
    """
    Options of ADMM.

    `tolerance` bounds the violation of the optimality conditions, relative to the largest
    lambda_k; `over_relaxation` lies in [1, 1.9]; `rho` is the initial penalty parameter, for
    columns of length 1; a polish is tried early, for a good start, and then every `polish_every`
    iterations.

    :raises OptionError: if a value is out of range.
    """

    max_iterations: int = 20000
    tolerance: float = 1e-7
    over_relaxation: float = 1.6
    rho: float = 0.1
    polish_every: int = 25

    def __post_init__(self) -> None:
        check_positive(self, 'admm')
        for name, low, high in (('tolerance', 0.0, 1.0), ('over_relaxation', 1.0, 1.9)):
            if not low <= getattr(self, name) <= high:
                raise OptionError(f'admm: {name} is {getattr(self, name)}; it must lie in '
                                  f'[{low:g}, {high:g}]')


@dataclass(eq=False)
class AdmmState:
    """State of ADMM, for columns of length 1: z, the scaled dual y, and rho."""

    z: FloatArray
    y: FloatArray
    rho: float


@dataclass(frozen=True)
class AdmmResult:
    """
    Final state of ADMM and its accuracy.

    `primal_residual` |x - z| and `dual_residual` rho |z - z_old| are those of one more iteration
    from the final state, after the polish.
    """

    state: AdmmState
    iterations: int
    primal_residual: float
    dual_residual: float
    violation: float
    polished: bool
    converged: bool


def soft_threshold(v: FloatArray, threshold: FloatArray | float) -> FloatArray:
    """Return sign(v) max(|v| - threshold, 0) (Yu 2022, Eq. 13)."""
    return np.sign(v) * np.maximum(np.abs(v) - threshold, 0.0)


def violation(z: FloatArray, gradient: FloatArray, penalties: FloatArray) -> float:
    """
    Return the largest violation of the optimality conditions, relative to the largest penalty.

    With gradient = G z - c: -gradient_k = lambda_k sign(z_k) where z_k is not 0, and
    |gradient_k| <= lambda_k where it is.
    """
    active = z != 0.0
    excess = np.where(active, np.abs(gradient + penalties * np.sign(z)),
                      np.maximum(np.abs(gradient) - penalties, 0.0))
    return float(excess.max(initial=0.0) / max(penalties.max(initial=0.0), 1e-300))


def solve(gram: FloatArray, correlation: FloatArray, penalties: FloatArray, start: AdmmState,
          options: AdmmOptions = AdmmOptions()) -> AdmmResult:
    """
    Run ADMM from `start` until the optimality conditions hold.

    :param gram: G (K, K) of columns of length 1.
    :param correlation: c (K,).
    :param penalties: lambda_k >= 0 (K,), at least one of them positive.
    :return: the result; `converged` is True if the tolerance was reached.
    :raises FitError: if the numbers are not finite.
    """
    if not (np.isfinite(gram).all() and np.isfinite(correlation).all()):
        raise FitError('admm: the regressor or the torque is not finite')
    if not len(correlation):
        return AdmmResult(start, 0, 0.0, 0.0, 0.0, False, True)
    z, y, rho = start.z.copy(), start.y.copy(), start.rho
    inverse = _inverse(gram, rho)
    for iteration in range(1, options.max_iterations + 1):
        x = inverse @ (correlation + rho * (z - y))                      # Eq. 12
        relaxed = options.over_relaxation * x + (1.0 - options.over_relaxation) * z
        z_old, z = z, soft_threshold(relaxed + y, penalties / rho)       # Eq. 13
        y += relaxed - z                                                 # Eq. 14
        if iteration % options.polish_every and iteration not in (
                _FIRST_POLISH, options.max_iterations):
            continue
        primal = float(np.linalg.norm(x - z))
        dual = float(rho * np.linalg.norm(z - z_old))
        polished = polish(gram, correlation, penalties, z, options.tolerance)
        for candidate, is_polished in ((polished, True), (z, False)):
            error = violation(candidate, gram @ candidate - correlation, penalties)
            if error <= options.tolerance:
                state = AdmmState(candidate, (correlation - gram @ candidate) / rho, rho)
                return AdmmResult(state, iteration,
                                  *_residuals(inverse, correlation, penalties, state),
                                  error, is_polished, True)
        factor = _rebalance(primal, dual)
        if factor != 1.0:
            rho *= factor
            y /= factor
            inverse = _inverse(gram, rho)
    error = violation(z, gram @ z - correlation, penalties)
    state = AdmmState(z, y, rho)
    return AdmmResult(state, options.max_iterations,
                      *_residuals(inverse, correlation, penalties, state), error, False, False)


def _residuals(inverse: FloatArray, correlation: FloatArray, penalties: FloatArray,
               state: AdmmState) -> tuple[float, float]:
    """Return the primal and the dual residual of one iteration without over-relaxation."""
    x = inverse @ (correlation + state.rho * (state.z - state.y))
    z = soft_threshold(x + state.y, penalties / state.rho)
    return (float(np.linalg.norm(x - z)), float(state.rho * np.linalg.norm(z - state.z)))


def polish(gram: FloatArray, correlation: FloatArray, penalties: FloatArray,
           z: FloatArray, tolerance: float) -> FloatArray:
    """
    Return the exact minimiser, by an active-set method from ADMM's iterate z.

    On a support with given signs the minimiser solves a linear system. If that reverses a sign,
    the step stops at the first coefficient that reaches 0, which leaves the support. If the
    optimality conditions are violated outside the support, the worst violator enters. Linearly
    dependent columns are removed first. Each step lowers the objective, so the method ends; it is
    limited to a few times K steps.
    """
    z, signs = z.copy(), np.sign(z)
    for _ in range(3 * len(z) + 10):
        active = np.flatnonzero(signs)
        signed = penalties[active] * signs[active]
        target = _minimiser(gram[active[:, None], active], correlation[active] - signed,
                            signed, z[active])
        reversed_ = (target * signs[active] < 0.0) & (z[active] != target)
        if reversed_.any():
            _step_to_zero(z, signs, active, target, reversed_)
            continue
        z[active] = target
        gradient = gram[:, active] @ target - correlation
        excess = np.where(signs == 0.0, np.abs(gradient) - penalties, -np.inf)
        worst = int(np.argmax(excess))
        if excess[worst] <= tolerance * penalties.max():
            break
        signs[worst] = -np.sign(gradient[worst])
    return z


def _step_to_zero(z: FloatArray, signs: FloatArray, active: IntArray, target: FloatArray,
                  reversed_: BoolArray) -> None:
    """Move towards `target` until the first coefficient with reversed sign is 0; drop it."""
    start = z[active]
    steps = np.where(reversed_, start / np.where(reversed_, start - target, 1.0), np.inf)
    first = int(np.argmin(steps))
    z[active] = start + steps[first] * (target - start)
    z[active[first]] = signs[active[first]] = 0.0


def _rebalance(primal: float, dual: float) -> float:
    """Return the factor of rho that balances the two residuals."""
    if primal == 0.0 or dual == 0.0:
        return 1.0
    ratio = np.sqrt(primal / dual)
    return float(np.clip(ratio, 0.1, 10.0)) if not 0.5 < ratio < 2.0 else 1.0


def _inverse(gram: FloatArray, rho: float) -> FloatArray:
    shifted = gram.copy()
    shifted.ravel()[::len(gram) + 1] += rho
    factor, failed = linalg.lapack.dpotrf(shifted, lower=True)
    inverse, failed_too = linalg.lapack.dpotri(factor, lower=True)
    if failed or failed_too:
        raise FitError('admm: the regressor cannot be factorised')
    lower = np.tril(inverse)
    lower += np.tril(inverse, -1).T
    return lower


def _minimiser(gram: FloatArray, right: FloatArray, signed: FloatArray,
               start: FloatArray) -> FloatArray:
    """
    Solve G x = r; for linearly dependent columns, descend from `start` without changing A x.

    In such a direction only the penalty changes, at a constant rate `signed`, so some coefficient
    reaches 0: the returned point is far enough for a sign to be reversed.
    """
    if not right.size:
        return right  # LAPACK of SciPy 1.11 rejects empty systems
    # LAPACK directly: for ten unknowns SciPy's wrappers take longer than the solution.
    _, x, failed = linalg.lapack.dposv(gram, right)
    if not failed:
        return np.asarray(x)
    values, vectors = linalg.eigh(gram, check_finite=False)
    kept = values > _DEPENDENT * values[-1]
    null = vectors[:, ~kept]
    descent = -null @ (null.T @ signed)
    steepness = float(np.abs(descent).max(initial=0.0))
    if steepness > _DEPENDENT * np.abs(signed).max():
        return start + descent * (_FAR * np.abs(start).max() / steepness)
    return np.asarray(vectors[:, kept] @ ((vectors[:, kept].T @ right) / values[kept]))
