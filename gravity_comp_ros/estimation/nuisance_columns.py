"""
Regressor columns of nuisance terms: friction, offset and inertia of each joint.

This module selects the terms that the motion identifies and that the fit keeps. A term is
kept if its coefficient differs significantly from 0 in a joint fit with gravity and all other
terms. An insignificant free column would only increase the variance of gravity.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.acceleration import accelerations
from gravity_comp_ros.data.condense import Condensation
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion_direction import (
    direction, find_shape, min_widths, Shape)
from gravity_comp_ros.estimation.inertia import Inertia, inertia_of
from gravity_comp_ros.models.noise import floor, of_second_differences
from gravity_comp_ros.models.nuisance import (
    COULOMB, INERTIA, NuisanceTerm, NuisanceTerms, OFFSET, VISCOUS)
from gravity_comp_ros.models.sparse.projected import orthonormal_basis
import numpy as np

# Minimum share of a column's norm outside the span of the joint's other columns. On a joint that
# moves in one direction only, Coulomb friction equals an offset and is not identifiable.
_MIN_INDEPENDENT = 0.02
# Minimum |coefficient| in standard deviations. With 21 terms, a term of zero size passes in 2 %
# of fits.
_MIN_SIGNIFICANCE = 3.3
# Minimum joint travel, in rad, for an offset. Over a shorter travel the joint's own gravity
# torque, which has sin q or cos q in every term, is nearly constant as well.
_MIN_OFFSET_TRAVEL = 0.2
# Prior size of a term as a share of the joint's RMS torque, for a joint without reversals.
# Reversals separate friction and offset from gravity; each one widens the prior by as much again.
_PRIOR_SIZE = {OFFSET: 0.02, COULOMB: 0.1, VISCOUS: 0.1, INERTIA: 1.0}
# Minimum RMS torque of a joint that the prior assumes, as a share of the largest joint's.
_MIN_RELATIVE_TORQUE = 0.1
# Maximum white noise that the prior assumes, as a share of the joint's torque.
_MAX_RELATIVE_NOISE = 0.02
# Minimum speed, in rad/s, at which the direction of motion counts.
_MIN_SPEED = 0.01
# Factor by which the speed or distance of a reversal is uncertain: a payload of 2 kg divides it by
# 1.8 at an outer joint of an arm in MuJoCo.
_WIDTH_FACTOR = 1.65
# Acceleration, in rad/s^2, at which the prior of a joint's own inertia in slow motion has the
# largest RMS torque of the arm.
_INERTIA_ACCELERATION = 1.0


@dataclass(frozen=True)
class Column:
    """The term of a column: its kind, and `joint` and `source` as joint numbers."""

    kind: str
    joint: int
    source: int | None = None


@dataclass(frozen=True, eq=False)
class NuisanceColumns:
    """
    K columns of torque per unit of coefficient: `values` (K, m), each of one joint's torque.

    `shapes` are the friction shapes of the joints. `prior_std` (K,) are prior standard deviations
    of the coefficients, per N·m of noise: friction and offset are small parts of the torque,
    which matters where a short motion does not separate them from gravity.
    """

    columns: tuple[Column, ...]
    values: FloatArray
    shapes: tuple[Shape, ...]
    prior_std: FloatArray

    def dense(self) -> FloatArray | None:
        """Return the columns (K, N, m) with 0 in the torques of other joints; None without any."""
        if not self.columns:
            return None
        dense = np.zeros((len(self.columns), len(self.shapes), self.values.shape[1]))
        for k, column in enumerate(self.columns):
            dense[k, column.joint] = self.values[k]
        return dense

    def select(self, keep: Sequence[int] | np.ndarray) -> NuisanceColumns:
        """Return some of the columns."""
        kept = [int(k) for k in keep]
        return NuisanceColumns(tuple(self.columns[k] for k in kept), self.values[kept],
                               self.shapes, self.prior_std[kept])

    def terms(self, names: tuple[str, ...], coefficients: FloatArray, covariance: FloatArray,
              noise: FloatArray) -> NuisanceTerms:
        """Return the fitted terms, for a model."""
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        terms = tuple(
            NuisanceTerm(c.kind, names[c.joint], float(x), float(s),
                         None if c.source is None else names[c.source])
            for c, x, s in zip(self.columns, coefficients, std))
        return NuisanceTerms(terms, np.array([shape.width for shape in self.shapes]),
                             np.array([shape.hold for shape in self.shapes]), noise,
                             np.array([float(shape.ramp) for shape in self.shapes]))


def initial_shapes(samples: JointSamples) -> tuple[Shape, ...]:
    """Return friction shapes before any fit, as wide as the noise of the speed requires."""
    return tuple(Shape(float(width)) for width in min_widths(samples))


def fitted_shapes(samples: JointSamples, qdd: FloatArray,
                  residual: FloatArray) -> tuple[Shape, ...]:
    """
    Return the friction shape of each joint, fitted to a residual (M, N) in N·m.

    :param qdd: accelerations (M, N), rad/s^2.
    """
    widths = min_widths(samples)
    return tuple(find_shape(samples, samples.q[:, n], samples.qd[:, n], qdd[:, n],
                            residual[:, n], float(widths[n]))
                 for n in range(samples.n_joints))


def build_columns(samples: JointSamples, shapes: tuple[Shape, ...], condensation: Condensation,
                  inertia: Inertia | None = None,
                  effects: FloatArray | None = None,
                  excluded: Collection[tuple[str, int]] = ()) -> NuisanceColumns:
    """
    Return the columns that this motion can identify, condensed.

    :param inertia: accelerations of the inertia terms; None for no such terms.
    :param effects: columns (K, N, m) of effects, condensed; their span needs no nuisance term.
    :param excluded: kinds and joint numbers of terms that an effect replaces.
    """
    size = len(condensation.first)
    selected: list[tuple[Column, FloatArray]] = []
    for n, shape in enumerate(shapes):
        q, qd = samples.q[:, n], samples.qd[:, n]
        candidates: list[tuple[Column, FloatArray]] = []
        if np.ptp(q) > _MIN_OFFSET_TRAVEL:
            candidates.append((Column(OFFSET, n), np.ones(samples.n_samples)))
        if qd.any():
            candidates += [(Column(COULOMB, n), direction(samples, q, qd, shape)),
                           (Column(VISCOUS, n), qd)]
        if inertia is not None:
            candidates += [(Column(INERTIA, n, j), inertia.qdd[:, j]) for j in inertia.sources(n)]
        candidates = [c for c in candidates if (c[0].kind, n) not in excluded]
        given = np.zeros((0, size)) if effects is None else effects[:, n]
        selected += _identifiable([(column, condensation.mean(x)) for column, x in candidates],
                                  given)
    values = np.array([x for _, x in selected]) if selected else np.zeros((0, size))
    columns = tuple(column for column, _ in selected)
    prior_std = _prior_std(columns, values, condensation.samples(samples),
                           inertia is not None and inertia.is_coupled)
    return NuisanceColumns(columns, values, shapes, prior_std)


def _prior_std(columns: tuple[Column, ...], values: FloatArray, samples: JointSamples,
               is_coupled: bool) -> FloatArray:
    """Return the prior standard deviation (K,) of each coefficient, per N·m of noise."""
    torque = np.sqrt((samples.tau ** 2).mean(axis=0))
    torque = np.maximum(torque,
                        _MIN_RELATIVE_TORQUE * max(float(torque.max(initial=0.0)), 1e-300))
    # Differences between unconnected poses include gravity as well as noise.
    noise = np.minimum(white_noise(samples), _MAX_RELATIVE_NOISE * torque)
    relative = torque / noise * (1.0 + _reversals(samples))
    size = np.sqrt((values ** 2).mean(axis=1))
    largest = float(torque.max(initial=0.0)) / _INERTIA_ACCELERATION
    return np.array([
        largest / noise[column.joint] if column.kind == INERTIA and not is_coupled
        else _PRIOR_SIZE[column.kind] * relative[column.joint] / max(width, 1e-300)
        for column, width in zip(columns, size)])


def _reversals(samples: JointSamples) -> FloatArray:
    """Return the number of reversals of each joint (N,)."""
    counts = np.zeros(samples.n_joints)
    for n in range(samples.n_joints):
        moving = np.abs(samples.qd[:, n]) > _MIN_SPEED
        signs, runs = np.sign(samples.qd[moving, n]), samples.runs[moving]
        counts[n] = np.count_nonzero((np.diff(signs) != 0.0) & (np.diff(runs) == 0))
    return counts


def white_noise(samples: JointSamples) -> FloatArray:
    """Return the standard deviation (N,) in N·m of the torque between consecutive samples."""
    within = samples.runs[2:] == samples.runs[:-2]
    if not within.any():
        return np.full(samples.n_joints, floor(samples.tau))
    return np.maximum(of_second_differences(samples.tau, within), floor(samples.tau))


def nuisance_torque(nuisance: NuisanceTerms, samples: JointSamples) -> FloatArray:
    """
    Return the torque (M, N) in N·m of fitted nuisance terms on other samples of the same joints.

    Terms of joints that are missing from the samples are left out.
    """
    total = np.zeros(samples.q.shape)
    inertia = None
    for term in nuisance.terms:
        if term.joint not in samples.names or (term.source or term.joint) not in samples.names:
            continue
        n = samples.names.index(term.joint)
        if term.kind == COULOMB:
            column = _direction(nuisance, samples, n)
        elif term.kind == VISCOUS:
            column = samples.qd[:, n]
        elif term.kind == INERTIA:
            if inertia is None:
                inertia = inertia_of(samples, accelerations(samples))
            column = inertia.qdd[:, samples.names.index(term.source or term.joint)]
        else:
            column = np.ones(samples.n_samples)
        total[:, n] += term.value * column
    return total


def reversal_std(nuisance: NuisanceTerms, samples: JointSamples) -> FloatArray:
    """
    Return the standard deviation (M, N) in N·m of Coulomb friction near reversals.

    The speed over which friction reverses depends on load and lubrication. In samples other than
    those of the fit it is uncertain by the factor `_WIDTH_FACTOR`.
    """
    std = np.zeros(samples.q.shape)
    for name, term in nuisance.of(COULOMB).items():
        if name in samples.names:
            n = samples.names.index(name)
            wide = _direction(nuisance, samples, n, _WIDTH_FACTOR)
            narrow = _direction(nuisance, samples, n, 1.0 / _WIDTH_FACTOR)
            std[:, n] = 0.5 * np.abs(term.value * (wide - narrow))
    return std


def _direction(nuisance: NuisanceTerms, samples: JointSamples, joint: int,
               factor: float = 1.0) -> FloatArray:
    """Return the direction (M,) of a joint's friction; `factor` widens its reversal."""
    shape = Shape(factor * float(nuisance.width[joint]), factor * float(nuisance.hold[joint]),
                  bool(nuisance.ramp[joint]))
    return direction(samples, samples.q[:, joint], samples.qd[:, joint], shape)


def _identifiable(candidates: list[tuple[Column, FloatArray]], given: FloatArray
                  ) -> list[tuple[Column, FloatArray]]:
    """Return the columns outside the span of those before them and of `given` (K, m)."""
    kept: list[tuple[Column, FloatArray]] = []
    basis = orthonormal_basis(given.T)
    for column, x in candidates:
        length = float(np.linalg.norm(x))
        outside = x - basis @ (basis.T @ x)
        outside -= basis @ (basis.T @ outside)
        independent = float(np.linalg.norm(outside))
        if length == 0.0 or independent < _MIN_INDEPENDENT * length:
            continue
        kept.append((column, x))
        basis = np.column_stack([basis, outside / independent])
    return kept


def significant(coefficients: FloatArray, covariance: FloatArray) -> list[int]:
    """
    Return the indices of significant coefficients (K,), by backward elimination.

    :param covariance: theirs (K, K), from a joint fit with gravity.
    """
    kept = list(range(len(coefficients)))
    x, spread = coefficients.copy(), covariance.copy()
    while kept:
        z = np.abs(x) / np.sqrt(np.maximum(np.diag(spread), 1e-300))
        k = int(np.argmin(z))
        if z[k] >= _MIN_SIGNIFICANCE:
            break
        # Condition the other coefficients on this one being 0.
        gain = spread[:, k] / max(float(spread[k, k]), 1e-300)
        rest = [j for j in range(len(kept)) if j != k]
        x = (x - gain * x[k])[rest]
        spread = (spread - np.outer(gain, spread[k]))[np.ix_(rest, rest)]
        kept.pop(k)
    return kept
