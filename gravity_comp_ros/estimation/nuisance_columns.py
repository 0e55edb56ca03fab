"""
Columns of nuisance terms: friction, offset and inertia of every joint, as regressors.

Which of them a motion can identify, and which the data ask for, is decided here. A term is kept
if its coefficient is further from 0 than chance allows, gravity and all other terms fitted beside
it: a column that is free without need costs accuracy of gravity.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.condense import Condensation
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion import accelerations
from gravity_comp_ros.effects.motion_direction import (
    direction, find_shape, least_widths, Shape)
from gravity_comp_ros.models.noise import floor, of_second_differences
from gravity_comp_ros.models.nuisance import (
    COULOMB, INERTIA, NuisanceTerm, NuisanceTerms, OFFSET, VISCOUS)
from gravity_comp_ros.models.sparse.projected import orthonormal_basis
import numpy as np

# A column of which less than this share (of its length) lies outside the span of the joint's
# other columns is not identifiable: on a joint that moves one way, Coulomb friction is an offset.
_IDENTIFIABLE = 0.02
# Coefficients nearer to 0 than this many standard deviations are dropped. With 21 terms, 3.3
# lets a term in by chance in 2 % of fits.
_SIGNIFICANT = 3.3
# rad. Over a shorter way the joint's own gravity torque, which has sin q or cos q in every term,
# is a constant itself.
_TELLS_OFFSET = 0.2
# The usual size of a term as a share of the joint's torque, root mean square, of a joint that has
# not turned round yet: friction and offset are told from gravity by going to and fro. Each
# reversal widens it by as much again.
_USUAL = {OFFSET: 0.02, COULOMB: 0.1, VISCOUS: 0.1, INERTIA: 1.0}
# A joint's torque counts as this share of the largest joint's at least.
_LEAST_TORQUE = 0.1
# White noise counts as this share of a joint's torque at most.
_LARGEST_NOISE = 0.02
# rad/s: slower joints may go either way.
_MOVING = 0.01
# rad/s^2: accelerations below this (root mean square) move no torque that could be seen.
_LEAST_ACCELERATION = 0.05


@dataclass(frozen=True)
class Column:
    """Which term a column belongs to: `joint` and `source` are joint numbers."""

    kind: str
    joint: int
    source: int | None = None


@dataclass(frozen=True, eq=False)
class NuisanceColumns:
    """
    K columns of torque per unit of coefficient: `values` (K, m), each of one joint's torque.

    `shapes` say how the direction of motion of each joint was found. `spread` (K,) are standard
    deviations of the coefficients before any data, per N·m of noise: friction and offsets are a
    part of the torque, and where a short motion does not tell them from gravity, they are small.
    """

    columns: tuple[Column, ...]
    values: FloatArray
    shapes: tuple[Shape, ...]
    spread: FloatArray

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
                               self.shapes, self.spread[kept])

    def terms(self, names: tuple[str, ...], coefficients: FloatArray, covariance: FloatArray,
              noise: FloatArray) -> NuisanceTerms:
        """Return the fitted terms, for a model."""
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        found = tuple(
            NuisanceTerm(c.kind, names[c.joint], float(x), float(s),
                         None if c.source is None else names[c.source])
            for c, x, s in zip(self.columns, coefficients, std))
        return NuisanceTerms(found, np.array([shape.width for shape in self.shapes]),
                             np.array([shape.hold for shape in self.shapes]), noise)


def plain_shapes(samples: JointSamples) -> tuple[Shape, ...]:
    """Return directions of motion as the noise of the speed asks for, before any fit."""
    return tuple(Shape(float(width)) for width in least_widths(samples))


def fitted_shapes(samples: JointSamples, qdd: FloatArray,
                  residual: FloatArray) -> tuple[Shape, ...]:
    """
    Return how the friction of each joint turns, as a residual (M, N) in N·m shows it.

    :param qdd: accelerations (M, N), rad/s^2.
    """
    least = least_widths(samples)
    return tuple(find_shape(samples, samples.q[:, n], samples.qd[:, n], qdd[:, n],
                            residual[:, n], float(least[n]))
                 for n in range(samples.n_joints))


def build_columns(samples: JointSamples, shapes: tuple[Shape, ...], means: Condensation,
                  qdd: FloatArray | None = None,
                  effects: FloatArray | None = None,
                  excluded: Collection[tuple[str, int]] = ()) -> NuisanceColumns:
    """
    Return the columns that this motion can identify, condensed.

    :param qdd: accelerations (M, N) in rad/s^2 where fast samples are fitted: then inertia has
        columns as well.
    :param effects: columns (K, N, m) of effects, condensed: what they span needs no nuisance term.
    :param excluded: kinds and joint numbers of terms that an effect takes the place of.
    """
    found: list[tuple[Column, FloatArray]] = []
    for n, shape in enumerate(shapes):
        q, qd = samples.q[:, n], samples.qd[:, n]
        candidates: list[tuple[Column, FloatArray]] = []
        if np.ptp(q) > _TELLS_OFFSET:
            candidates.append((Column(OFFSET, n), np.ones(samples.n_samples)))
        if qd.any():
            candidates += [(Column(COULOMB, n), direction(samples, q, qd, shape)),
                           (Column(VISCOUS, n), qd)]
        if qdd is not None:
            sources = [j for j in range(samples.n_joints)
                       if np.sqrt((qdd[:, j] ** 2).mean()) > _LEAST_ACCELERATION]
            candidates += [(Column(INERTIA, n, j), qdd[:, j]) for j in sources]
        candidates = [c for c in candidates if (c[0].kind, n) not in excluded]
        given = np.zeros((0, len(means.first))) if effects is None else effects[:, n]
        found += _identifiable([(column, means.mean(x)) for column, x in candidates], given)
    size = len(means.first)
    values = np.array([x for _, x in found]) if found else np.zeros((0, size))
    columns = tuple(column for column, _ in found)
    spread = _spread(columns, values, means.samples(samples))
    return NuisanceColumns(columns, values, shapes, spread)


def _spread(columns: tuple[Column, ...], values: FloatArray, samples: JointSamples) -> FloatArray:
    """Return the standard deviation (K,) of each coefficient before any data, per N·m of noise."""
    torque = np.sqrt((samples.tau ** 2).mean(axis=0))
    torque = np.maximum(torque, _LEAST_TORQUE * max(float(torque.max(initial=0.0)), 1e-300))
    # Poses that do not follow each other differ by more than noise.
    noise = np.minimum(white_noise(samples), _LARGEST_NOISE * torque)
    relative = torque / noise * (1.0 + _reversals(samples))
    size = np.sqrt((values ** 2).mean(axis=1))
    usual = np.array([_USUAL[column.kind] * relative[column.joint] for column in columns])
    return np.asarray(usual / np.maximum(size, 1e-300)) if columns else np.zeros(0)


def _reversals(samples: JointSamples) -> FloatArray:
    """Return how often each joint (N,) turns round."""
    counts = np.zeros(samples.n_joints)
    for n in range(samples.n_joints):
        moving = np.abs(samples.qd[:, n]) > _MOVING
        ways, runs = np.sign(samples.qd[moving, n]), samples.runs[moving]
        counts[n] = np.count_nonzero((np.diff(ways) != 0.0) & (np.diff(runs) == 0))
    return counts


def white_noise(samples: JointSamples) -> FloatArray:
    """Return the standard deviation (N,) in N·m of what differs from one sample to the next."""
    within = samples.runs[2:] == samples.runs[:-2]
    if not within.any():
        return np.full(samples.n_joints, floor(samples.tau))
    return np.maximum(of_second_differences(samples.tau, within), floor(samples.tau))


def nuisance_torque(nuisance: NuisanceTerms, samples: JointSamples) -> FloatArray:
    """
    Return the torque (M, N) in N·m of fitted nuisance terms on other samples of the same joints.

    Terms of a joint that the samples lack are left out.
    """
    total = np.zeros(samples.q.shape)
    qdd = None
    for term in nuisance.terms:
        if term.joint not in samples.names or (term.source or term.joint) not in samples.names:
            continue
        n = samples.names.index(term.joint)
        if term.kind == COULOMB:
            shape = Shape(float(nuisance.width[n]), float(nuisance.hold[n]))
            column = direction(samples, samples.q[:, n], samples.qd[:, n], shape)
        elif term.kind == VISCOUS:
            column = samples.qd[:, n]
        elif term.kind == INERTIA:
            qdd = accelerations(samples) if qdd is None else qdd
            column = qdd[:, samples.names.index(term.source or term.joint)]
        else:
            column = np.ones(samples.n_samples)
        total[:, n] += term.value * column
    return total


def _identifiable(candidates: list[tuple[Column, FloatArray]], given: FloatArray
                  ) -> list[tuple[Column, FloatArray]]:
    """Return the columns outside the span of those before them and of `given` (K, m)."""
    kept: list[tuple[Column, FloatArray]] = []
    basis = orthonormal_basis(given.T)
    for column, x in candidates:
        length = float(np.linalg.norm(x))
        outside = x - basis @ (basis.T @ x)
        outside -= basis @ (basis.T @ outside)
        left = float(np.linalg.norm(outside))
        if length == 0.0 or left < _IDENTIFIABLE * length:
            continue
        kept.append((column, x))
        basis = np.column_stack([basis, outside / left])
    return kept


def significant(coefficients: FloatArray, covariance: FloatArray) -> list[int]:
    """
    Return which coefficients (K,) the data tell from 0, the others dropped one by one.

    :param covariance: theirs (K, K), gravity fitted beside.
    """
    left = list(range(len(coefficients)))
    x, spread = coefficients.copy(), covariance.copy()
    while left:
        z = np.abs(x) / np.sqrt(np.maximum(np.diag(spread), 1e-300))
        k = int(np.argmin(z))
        if z[k] >= _SIGNIFICANT:
            break
        # Conditioned on this coefficient being 0.
        gain = spread[:, k] / max(float(spread[k, k]), 1e-300)
        rest = [j for j in range(len(left)) if j != k]
        x = (x - gain * x[k])[rest]
        spread = (spread - np.outer(gain, spread[k]))[np.ix_(rest, rest)]
        left.pop(k)
    return left
