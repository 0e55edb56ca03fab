"""
What information says of a question: how surely it will be settled, and how exactly.

T-optimality (Atkinson & Fedorov 1975) asks how far the torque of the effect is from the best that
an alternative can do in its place, nuisance terms fitted along,

    lambda = theta.T (S_ee - S_ea S_aa^-1 S_ae) theta,

S being the information that the nuisance terms leave (a Schur complement). The worst alternative
counts. D-optimality asks for the information on the coefficients, S_ee itself.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.diagnosis.options import MIN_UNABSORBED
import numpy as np
from scipy import special
from scipy.linalg import cho_factor, cho_solve

# Separation, in standard errors, with which a diagnosis finds every other effect, and the standard
# deviation of its logarithm. It tests many effects on many joints, on data that it has not fitted.
# Fitted to simulated arms (`bench.planning.calibrate`).
_HALF, _WIDTH = 7.69, 0.59
# Information is worth its logarithm from about this separation on.
_SCALE = 4.0


@dataclass(frozen=True)
class Answer:
    """
    How far a target is from what could explain it, and how exactly its size is known.

    `separations` are the square roots of lambda beside nuisance terms alone, then beside each
    alternative. `spread` (K,) are standard errors of the target's coefficients beside nuisance
    terms. `left` is the share of the target's torque that the gravity of a diagnosis cannot
    imitate: below `MIN_UNABSORBED` it calls the size uncertain whatever the noise.
    """

    separations: tuple[float, ...]
    spread: FloatArray
    left: float = 1.0

    @property
    def separation(self) -> float:
        """Return that of the worst alternative."""
        return min(self.separations)

    @property
    def worst(self) -> int | None:
        """Return the number of the worst alternative, None if nuisance terms come closest."""
        number = int(np.argmin(self.separations))
        return number - 1 if number else None

    def without(self, alternatives: Collection[int]) -> Answer:
        """Return what is left if some alternatives are none."""
        return replace(self, separations=tuple(
            np.inf if k - 1 in alternatives else s for k, s in enumerate(self.separations)))

    @property
    def value(self) -> float:
        """
        What the choice of a motion maximises.

        It grows by the logarithm: the size of an effect may be a fraction of what is assumed, and
        one target is not worth all the time.
        """
        shown = min(1.0, self.left / MIN_UNABSORBED) * self.separation
        return float(np.log1p((shown / _SCALE) ** 2))


def chance(separation: float) -> float:
    """Return the chance that a diagnosis finds an effect with this separation."""
    return float(special.ndtr(np.log(max(separation, 1e-9) / _HALF) / _WIDTH))


def answer(information: FloatArray, prior: FloatArray, widths: tuple[int, ...],
           size: FloatArray, n_gravity: int = 0, imitation: float = 1.0) -> Answer:
    """
    Return what an information matrix (P, P) says of a question.

    :param prior: information (Z,) on the nuisance terms, which come first.
    :param widths: how many columns the target has, then each alternative.
    :param size: coefficients (K,) of the target.
    :param n_gravity: of the nuisance terms so many, the first ones, are gravity's.
    :param imitation: the share that the gravity of a diagnosis leaves of what these leave.
    """
    z, k = len(prior), widths[0]
    left = _beside(information, prior, slice(z, None))
    own = left[:k, :k]
    separations = [_separation(own, size)]
    at = k
    for width in widths[1:]:
        there, full = slice(at, at + width), slice(z + at, z + at + width)
        inverse = _inverse(left[there, there], information[full, full])
        separations.append(_separation(own - left[:k, there] @ inverse @ left[there, :k], size))
        at += width
    variance = np.diag(_inverse(own, information[z:z + k, z:z + k]))
    spread = np.where(np.diag(own) > 1e-9 * np.diag(information[z:z + k, z:z + k]),
                      np.sqrt(np.maximum(variance, 0.0)), np.inf)
    return Answer(tuple(separations), spread,
                  imitation * _left(information, prior[:n_gravity], slice(z, z + k), size))


def _beside(information: FloatArray, prior: FloatArray, columns: slice) -> FloatArray:
    """Return the information on columns that the first terms leave, with their prior (Z,)."""
    z = len(prior)
    known = information[:z, :z] + np.diag(prior)
    scale = 1.0 / np.sqrt(np.diag(known))
    factor = cho_factor(known * np.outer(scale, scale) + 1e-10 * np.eye(z))
    cross = information[:z, columns] * scale[:, None]
    return np.asarray(information[columns, columns] - cross.T @ cho_solve(factor, cross))


def _left(information: FloatArray, gravity: FloatArray, own: slice, size: FloatArray) -> float:
    """Return the share of the target's torque that gravity, with its prior, cannot imitate."""
    whole = _separation(information[own, own], size)
    if not len(gravity) or whole == 0.0:
        return 1.0
    return _separation(_beside(information, gravity, own), size) / whole


def _separation(information: FloatArray, size: FloatArray) -> float:
    return float(np.sqrt(max(0.0, float(size @ information @ size))))


def _inverse(matrix: FloatArray, full: FloatArray) -> FloatArray:
    """Return the inverse of what is left of information, 0 where nothing is left of it."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    floor = 1e-9 * max(float(np.trace(full)), 1e-12)
    inverse = np.where(values > floor, 1.0 / np.maximum(values, floor), 0.0)
    return np.asarray((vectors * inverse) @ vectors.T)
