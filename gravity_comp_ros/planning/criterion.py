"""
Design criteria of a target effect: T-optimality for discrimination, D-optimality for estimation.

T-optimality (Atkinson & Fedorov 1975) is the squared distance of the target's torque from the
closest fit of an alternative, nuisance terms fitted jointly,

    lambda = theta.T (S_ee - S_ea S_aa^-1 S_ae) theta,

where S is the information matrix with the nuisance terms projected out (a Schur complement). The
criterion is the minimum over the alternatives. D-optimality uses the information on the
coefficients, S_ee.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.options import MIN_UNABSORBED
import numpy as np
from scipy import special
from scipy.linalg import cho_factor, cho_solve

# Power of a diagnosis: the separation, in standard errors, with power 0.5, and the standard
# deviation of its logarithm. They allow for the many effects and joints that a diagnosis tests, on
# held-out data. Fitted to simulated arms (`bench.planning.calibrate`).
_HALF_POWER, _LOG_STD = 9.34, 0.66
# Standard deviation of the logarithm of the unabsorbed share in a diagnosis, relative to that of a
# plan: the diagnosis fits gravity again.
_ABSORPTION_LOG_STD = 0.3
# Separation from which on the utility grows with the logarithm of the information.
_UTILITY_SCALE = 4.0


@dataclass(frozen=True)
class EffectScore:
    """
    Separation of a target from its alternatives, and standard errors of its coefficients.

    `separations` are the square roots of lambda: first with nuisance terms only, then with each
    alternative. `std` (K,) are standard errors of the target's coefficients, fitted jointly with
    the nuisance terms. `unabsorbed` is the share of the target's torque outside the gravity terms
    of a diagnosis; below `MIN_UNABSORBED` the diagnosis reports an uncertain size at any noise.
    """

    separations: tuple[float, ...]
    std: FloatArray
    unabsorbed: float = 1.0

    @property
    def separation(self) -> float:
        """Return the separation from the closest alternative."""
        return min(self.separations)

    @property
    def closest(self) -> int | None:
        """Return the number of the closest alternative, None if nuisance terms are closer."""
        number = int(np.argmin(self.separations))
        return number - 1 if number else None

    def without(self, alternatives: Collection[int]) -> EffectScore:
        """Return the score without some alternatives, given by number."""
        return replace(self, separations=tuple(
            np.inf if k - 1 in alternatives else s for k, s in enumerate(self.separations)))

    @property
    def chance_of_certain_size(self) -> float:
        """Return the probability that the unabsorbed share in a diagnosis is large enough."""
        ratio = max(self.unabsorbed, 1e-9) / MIN_UNABSORBED
        return float(special.ndtr(np.log(ratio) / _ABSORPTION_LOG_STD))

    @property
    def utility(self) -> float:
        """
        Return the utility that the selection of a motion maximises.

        It is logarithmic in the information: the effect may be smaller than assumed, and one
        target must not take the whole duration.
        """
        effective = self.chance_of_certain_size * self.separation
        return float(np.log1p((effective / _UTILITY_SCALE) ** 2))


def power(separation: float, required: float = 0.0) -> float:
    """
    Return the probability that a diagnosis detects an effect with this separation.

    :param required: the separation that its minimum share of the error corresponds to
        (`DesignContext.required_separation`).
    """
    half = max(_HALF_POWER, required)
    return float(special.ndtr(np.log(max(separation, 1e-9) / half) / _LOG_STD))


def effect_score(information: FloatArray, prior: FloatArray, widths: tuple[int, ...],
                 size: FloatArray, n_gravity: int = 0, gravity_factor: float = 1.0
                 ) -> EffectScore:
    """
    Return the score of a target from an information matrix (P, P).

    :param prior: prior information (Z,) on the nuisance terms, which come first.
    :param widths: the number of columns of the target, then of each alternative.
    :param size: assumed coefficients (K,) of the target.
    :param n_gravity: the number of gravity parameters, the first of the nuisance terms.
    :param gravity_factor: ratio of the torque shares outside the gravity terms of a diagnosis and
        outside these.
    """
    z, k = len(prior), widths[0]
    marginal = _schur_complement(information, prior, slice(z, None))
    own = marginal[:k, :k]
    separations = [_norm(own, size)]
    at = k
    for width in widths[1:]:
        there, full = slice(at, at + width), slice(z + at, z + at + width)
        inverse = _pseudo_inverse(marginal[there, there], information[full, full])
        cross = marginal[:k, there]
        separations.append(_norm(own - cross @ inverse @ marginal[there, :k], size))
        at += width
    target = slice(z, z + k)
    variance = np.diag(_pseudo_inverse(own, information[target, target]))
    std = np.where(np.diag(own) > 1e-9 * np.diag(information[target, target]),
                   np.sqrt(np.maximum(variance, 0.0)), np.inf)
    unabsorbed = _unabsorbed(information, prior[:n_gravity], target, size)
    return EffectScore(tuple(separations), std, gravity_factor * unabsorbed)


def _schur_complement(information: FloatArray, prior: FloatArray, columns: slice) -> FloatArray:
    """Return the information on columns with the first Z terms, of this prior, projected out."""
    z = len(prior)
    known = information[:z, :z] + np.diag(prior)
    scale = 1.0 / np.sqrt(np.diag(known))
    factor = cho_factor(known * np.outer(scale, scale) + 1e-10 * np.eye(z))
    cross = information[:z, columns] * scale[:, None]
    return np.asarray(information[columns, columns] - cross.T @ cho_solve(factor, cross))


def _unabsorbed(information: FloatArray, gravity: FloatArray, target: slice,
                size: FloatArray) -> float:
    """Return the share of the target's torque outside the gravity columns, with their prior."""
    whole = _norm(information[target, target], size)
    if not len(gravity) or whole == 0.0:
        return 1.0
    return _norm(_schur_complement(information, gravity, target), size) / whole


def _norm(information: FloatArray, size: FloatArray) -> float:
    return float(np.sqrt(max(0.0, float(size @ information @ size))))


def _pseudo_inverse(matrix: FloatArray, full: FloatArray) -> FloatArray:
    """Return the inverse of marginal information, 0 in directions without any."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    floor = 1e-9 * max(float(np.trace(full)), 1e-12)
    inverse = np.where(values > floor, 1.0 / np.maximum(values, floor), 0.0)
    return np.asarray((vectors * inverse) @ vectors.T)
