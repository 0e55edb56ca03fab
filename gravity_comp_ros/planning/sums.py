"""
Sums of products of the columns of a regression, along recorded and along planned motion.

Sums of several motions add: the posterior after a planned motion has the precision

    A = S^-1 + sum_j w_j (G_j of the recordings + G_j of the motion),

with G_j the products of the columns that act on joint j and w_j the weight of a squared residual
at the number of rows of both (`regression.noise`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

from gravity_comp_ros.data.runs import median_interval
from gravity_comp_ros.data.samples import (
    concatenate, evenly_picked, FloatArray, IntArray, JointSamples)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.planning.workspace import Line, sampled
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.rows import Rows, rows_of
from gravity_comp_ros.regression.shared import State
from gravity_comp_ros.regression.term import Term, total_std
import numpy as np
from scipy.linalg import block_diag

Path = Sequence[Line]

# Samples of a planned motion per row: directions of motion are computed before the mean.
_PER_ROW = 3
# Motions whose sums are computed, and scored, together, which bounds the memory.
BATCH = 32
# Number of poses over which the standard deviation of gravity is taken.
_POSES = 300
# Assumed pause between the last recording and the planned motion, s.
_PAUSE = 60.0


def row_seconds(regression: Regression) -> float:
    """Return the duration of a row of the recordings, s."""
    rows = regression.problem.rows
    interval = median_interval(rows.t, rows.run)
    return regression.problem.options.row_seconds if np.isnan(interval) else interval


def motion_of(regression: Regression, paths: Sequence[Path]) -> Motion:
    """Return the motion of paths, each a run that begins after the recordings."""
    old, rate = regression.problem.samples, _PER_ROW / row_seconds(regression)
    parts = [sampled(path, rate) for path in paths]
    q, qd, qdd = (np.concatenate([states[k] for _, states in parts]) for k in range(3))
    end = max((start + float(old.t[old.runs == k].max(initial=0.0))
               for k, start in enumerate(old.starts)), default=0.0)
    samples = JointSamples(
        old.names, np.concatenate([t for t, _ in parts]), q, qd, np.zeros_like(q),
        np.repeat(np.arange(len(paths)), [len(t) for t, _ in parts]),
        tuple(f'planned {k}' for k in range(len(paths))),
        (end + _PAUSE,) * len(paths) if old.starts else (), qdd,
        tuple(range(len(paths))) if old.fingerprints else ())
    return _motion(regression, samples)


def joined(regression: Regression, planned: Motion) -> Motion:
    """Return the recordings and a planned motion together, as a later diagnosis sees them."""
    old = replace(regression.problem.samples, qdd=regression.motion.qdd)
    return _motion(regression, concatenate([old, planned.samples]))


def rows_of_planned(regression: Regression, planned: Motion) -> Rows:
    """Return the rows of a planned motion, as long as those of the recordings."""
    return rows_of(planned.samples, replace(
        regression.problem.options, max_rows=planned.samples.n_samples,
        row_seconds=row_seconds(regression)))


def _motion(regression: Regression, samples: JointSamples) -> Motion:
    shared, recorded = regression.shared, regression.motion
    assert samples.qdd is not None
    return Motion(samples, samples.qdd, shared.gravity(samples.q), shared.gradient,
                  recorded.chain, recorded.geometry, {'speed noise': recorded.speed_noise})


class Sums:
    """
    Weighted sums of products of L coefficients: those of the shared part, then of some terms.

    The shared part is in units `root` (P, P) of its prior, in which it is independent. `std` (L,)
    are the prior standard deviations, `recorded` (L, L) the products of the recordings' columns.
    `n_shared` is the number of the shared coefficients.
    """

    def __init__(self, regression: Regression, terms: Sequence[Term], seconds: float) -> None:
        """
        Compute the sums of the recordings.

        :param seconds: duration of the planned motion, which the weights depend on.
        """
        self.regression, self.terms = regression, tuple(terms)
        design, problem = regression.posterior.design, regression.problem
        self.n_shared = p = design.n_shared
        ends = p + np.cumsum([0, *(term.n_columns for term in self.terms)])
        self._at = {t: np.arange(a, b) for t, a, b in zip(self.terms, ends, ends[1:])}
        self.root = design.prior.root
        self.std = np.concatenate([np.ones(p), total_std(self.terms)])
        discrepancy = (problem.options.discrepancy * problem.scale.torque) ** 2
        self.weights = np.asarray(1.0 / (1.0 / regression.posterior.precision
                                         + discrepancy * seconds / row_seconds(regression)))
        design.add(self.terms)
        self.recorded = np.zeros((ends[-1], ends[-1]))
        for j, weight in enumerate(self.weights):
            acting = self._acting(j)
            columns, places = design.selected(j, acting), self.places(acting)
            units = block_diag(self.root, np.eye(len(columns) - p))
            self.recorded[np.ix_(places, places)] += weight * (
                units.T @ design.gram[j][np.ix_(columns, columns)] @ units)

    @cached_property
    def _gravity(self) -> FloatArray:
        """
        Return products (N, P, P) of the derivatives of each joint's gravity by shared parameters.

        They are means over the recorded poses.
        """
        samples = self.regression.problem.samples
        q = samples.q[evenly_picked(samples.n_samples, _POSES)]
        columns = self.regression.shared.columns(State(q, 0.0 * q, 0.0 * q)) @ self.root
        return np.asarray(np.einsum('pni,pnj->nij', columns, columns) / len(q))

    def gravity_std(self, a: FloatArray) -> FloatArray:
        """
        Return the standard deviation (C, N) in N·m of gravity over the recorded poses (RMS).

        :param a: sums (C, L, L).
        """
        here, p = self.places(self.regression.terms), self.n_shared
        precision = a[:, here[:, None], here] + np.diag(self.std[here] ** -2.0)
        variance = np.einsum('cij,nji->cn', np.linalg.inv(precision)[:, :p, :p], self._gravity,
                             optimize=True)
        return np.asarray(np.sqrt(np.maximum(variance, 1e-24)))

    def at(self, terms: Sequence[Term]) -> IntArray:
        """Return the numbers of the coefficients of some terms."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *(self._at[t] for t in terms)])

    def places(self, terms: Sequence[Term]) -> IntArray:
        """Return the numbers of the shared coefficients, then of some terms."""
        return np.concatenate([np.arange(self.n_shared), self.at(terms)])

    def added(self, paths: Sequence[Path]) -> FloatArray:
        """Return the sums (C, L, L) that each of C paths adds."""
        return np.concatenate([np.zeros((0, *self.recorded.shape)), *(
            self._added(paths[k:k + BATCH]) for k in range(0, len(paths), BATCH))])

    def _added(self, paths: Sequence[Path]) -> FloatArray:
        motion = motion_of(self.regression, paths)
        rows, samples = rows_of_planned(self.regression, motion), motion.samples
        # A path is smooth: the shared columns in the middle of a row are their mean.
        middle = rows.samples[rows.first + rows.count // 2]
        shared = self.regression.shared.columns(State(
            samples.q[middle], samples.qd[middle], motion.qdd[middle])) @ self.root
        own = {t: replace(t, columns=rows.mean(np.asarray(t.effect.columns(
            motion, t.joint_number, t.setting)))) for t in self.terms}
        total = np.zeros((len(paths), *self.recorded.shape))
        for j, weight in enumerate(self.weights):
            acting = self._acting(j)
            places = self.places(acting)
            columns = np.concatenate([shared[:, j], *(own[t].on(j) for t in acting)], axis=1)
            for k in range(len(paths)):
                x = columns[rows.run == k]
                total[k][np.ix_(places, places)] += weight * (x.T @ x)
        return total

    def _acting(self, j: int) -> list[Term]:
        return [t for t in self.terms if j in t.joints(len(self.weights))]
