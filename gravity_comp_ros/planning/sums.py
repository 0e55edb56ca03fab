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

from gravity_comp_ros.data.samples import concatenate, FloatArray, IntArray, JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.planning.segments import sampled, Segment
from gravity_comp_ros.regression.engine import Regression
from gravity_comp_ros.regression.rows import rows_of
from gravity_comp_ros.regression.shared import State
from gravity_comp_ros.regression.term import Term, total_std
import numpy as np

Path = Sequence[Segment]

# Samples of a planned motion per row: directions of motion are computed before the mean.
_PER_ROW = 3
# Rows of one batch of shared columns.
_BATCH = 2048
# Assumed pause between the last recording and the planned motion, s.
_PAUSE = 60.0


class PlannedMotion:
    """Planned paths as recordings that follow those of a regression."""

    def __init__(self, regression: Regression) -> None:
        self.regression = regression
        rows = regression.problem.rows
        between = np.diff(rows.t)[np.diff(rows.run) == 0]
        self.row_seconds = float(np.median(between)) if len(between) else (
            regression.problem.options.row_seconds)

    @property
    def rate(self) -> float:
        """Return the rate of planned samples, Hz."""
        return _PER_ROW / self.row_seconds

    def of(self, paths: Sequence[Path]) -> Motion:
        """Return the motion of paths; each is a run that begins after the recordings."""
        parts, old = [sampled(path, self.rate) for path in paths], self._samples
        end = max((start + float(old.t[old.runs == k].max(initial=0.0))
                   for k, start in enumerate(old.starts)), default=0.0)
        q, qd, qdd = (np.concatenate([part[k] for _, part in parts]) for k in range(3))
        number = old.n_runs + np.arange(len(paths))
        samples = JointSamples(
            old.names, np.concatenate([t for t, _ in parts]), q, qd, np.zeros_like(q),
            np.repeat(number, [len(t) for t, _ in parts]),
            (*old.run_labels, *(f'planned {k}' for k in number)),
            (*old.starts, *[end + _PAUSE] * len(paths)) if old.starts else (), qdd,
            (*old.fingerprints, *range(len(paths))) if old.fingerprints else ())
        return self._motion(samples)

    def joined(self, path: Path) -> Motion:
        """Return the recordings and a path together, as a later diagnosis sees them."""
        old, planned = self._samples, self.of([path]).samples
        new = planned.run(old.n_runs)
        return self._motion(concatenate([replace(old, qdd=self.regression.motion.qdd), new]))

    @property
    def _samples(self) -> JointSamples:
        return self.regression.problem.samples

    def _motion(self, samples: JointSamples) -> Motion:
        shared, recorded = self.regression.shared, self.regression.motion
        assert samples.qdd is not None
        return Motion(samples, samples.qdd, shared.gravity(samples.q), shared.gradient,
                      recorded.chain, recorded.geometry, {'speed noise': recorded.speed_noise})


class Sums:
    """
    Weighted sums of products of L coefficients: those of the shared part, then of some terms.

    `std` (L,) are their prior standard deviations, `recorded` (L, L) the products of the
    recordings' columns with themselves, and `score` (L,) those with the torque plus the prior
    means over their variances.
    """

    def __init__(self, planned: PlannedMotion, terms: Sequence[Term], seconds: float) -> None:
        """
        Compute the sums of the recordings.

        :param seconds: duration of the planned motion, which the weights depend on.
        """
        self.planned, self.terms = planned, tuple(terms)
        regression, design = planned.regression, planned.regression.posterior.design
        problem, start = regression.problem, design.n_shared
        self.at: dict[Term, IntArray] = {}
        for term in self.terms:
            self.at[term] = np.arange(start, start + term.n_columns)
            start += term.n_columns
        self.std = np.concatenate([design.prior_std, total_std(self.terms)])
        discrepancy = (problem.options.discrepancy * problem.scale.torque) ** 2
        self.weights = np.asarray(1.0 / (1.0 / regression.posterior.precision
                                         + discrepancy * seconds / planned.row_seconds))
        design.add(self.terms)
        self.recorded, self.score = np.zeros((start, start)), np.zeros(start)
        p = design.n_shared
        self.score[:p] = design.prior_mean * self.std[:p] ** -2.0
        for j, weight in enumerate(self.weights):
            acting, places = self._acting(j)
            columns = design.selected(j, acting)
            self.recorded[np.ix_(places, places)] += weight * design.gram[j][
                np.ix_(columns, columns)]
            self.score[places] += weight * design.cross[j][columns]

    def places(self, terms: Sequence[Term]) -> IntArray:
        """Return the numbers of the coefficients of some terms."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *(self.at[t] for t in terms)])

    def with_shared(self, terms: Sequence[Term]) -> IntArray:
        """Return the numbers of the shared coefficients, then of some terms."""
        n_shared = self.planned.regression.posterior.design.n_shared
        return np.concatenate([np.arange(n_shared), self.places(terms)])

    def added(self, paths: Sequence[Path]) -> FloatArray:
        """Return the sums (C, L, L) that each of C paths adds."""
        motion, regression = self.planned.of(paths), self.planned.regression
        samples, n = motion.samples, len(self.weights)
        rows = rows_of(samples, replace(regression.problem.options, max_rows=samples.n_samples,
                                        row_seconds=self.planned.row_seconds))
        edges = np.searchsorted(rows.run, samples.n_runs - len(paths) + np.arange(len(paths) + 1))
        # A path is smooth: the shared columns in the middle of a row are their mean.
        middle = rows.samples[rows.first + rows.count // 2]
        shared = np.concatenate([regression.shared.columns(State(
            samples.q[some], samples.qd[some], motion.qdd[some]))
            for some in np.split(middle, range(_BATCH, len(middle), _BATCH))])
        own = {term: rows.mean(np.asarray(term.effect.columns(
            motion, term.joint_number, term.setting))) for term in self.terms}
        by_joint = [self._acting(j) for j in range(n)]
        total = np.zeros((len(paths), *self.recorded.shape))
        for k, (start, end) in enumerate(zip(edges, edges[1:])):
            for j, (acting, places) in enumerate(by_joint):
                columns = [own[t][start:end] for t in acting]
                x = np.concatenate([shared[start:end, j], *(
                    c[:, j] if c.ndim == 3 else c for c in columns)], axis=1)
                total[k][np.ix_(places, places)] += self.weights[j] * (x.T @ x)
        return total

    def _acting(self, j: int) -> tuple[list[Term], IntArray]:
        """Return the terms that act on a joint, and the numbers of its coefficients."""
        acting = [t for t in self.terms if j in t.joints(len(self.weights))]
        return acting, self.with_shared(acting)
