"""A problem: samples with their motion, rows and scales, the same for every linearisation."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from gravity_comp_ros.data.samples import BoolArray, FloatArray, IntArray, JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import FitError
from gravity_comp_ros.models import noise
from gravity_comp_ros.regression.candidates import TermFactory
from gravity_comp_ros.regression.options import EngineOptions
from gravity_comp_ros.regression.prior import Scale
from gravity_comp_ros.regression.rows import condensed, Rows, rows_of
from gravity_comp_ros.regression.shared import Shared
from gravity_comp_ros.regression.states import States, states_of
from gravity_comp_ros.regression.term import Term
import numpy as np


@dataclass(frozen=True, eq=False)
class Problem:
    """
    Samples with their motion, rows and scales; the same for every linearisation.

    `samples` are those `measured`, or their means (`rows.condensed`). `used` (U,) are the numbers
    of the measured samples that are fitted, `row_of` (U,) the row of each.
    """

    measured: JointSamples
    used: IntArray
    row_of: IntArray
    samples: JointSamples
    motion: Motion
    rows: Rows
    states: States
    scale: Scale
    y: FloatArray
    options: EngineOptions
    terms: dict[object, Term] = field(default_factory=dict)  # those that do not depend on gravity

    @classmethod
    def of(cls, measured: JointSamples, use: BoolArray | None = None,
           options: EngineOptions = EngineOptions()) -> Problem:
        """
        Return the problem of measured samples.

        :param use: mask (M,) of the samples to fit; None for all.
        :raises FitError: if there are none.
        """
        if use is None:
            use = np.ones(len(measured), dtype=bool)
        if not use.any():
            raise FitError('no samples to fit')
        means = condensed(measured, use, options)
        samples, rows = means.samples, rows_of(means.samples, options, means.use)
        row = np.full(len(samples), -1)
        row[rows.samples] = np.repeat(np.arange(rows.n_rows), rows.count)
        row = row[means.group]
        used = np.flatnonzero(use & (row >= 0))
        motion = Motion.of(samples, np.zeros_like(samples.q), _no_gradient)
        states = states_of(rows, samples.q, samples.qd, motion.qdd, options.cell_angle)
        scale = Scale.of(samples.select(rows.samples), options)
        return cls(measured, used, row[used], samples, motion, rows, states, scale,
                   rows.mean(samples.tau), options)

    def coarser(self, rows: int) -> Problem:
        """Return the problem of the same samples with at most a number of rows."""
        use = np.isin(np.arange(len(self.measured)), self.used)
        return Problem.of(self.measured, use, replace(
            self.options, max_rows=min(rows, self.options.max_rows),
            max_samples=self.options.max_samples * rows // self.options.max_rows))

    @property
    def n_measured(self) -> IntArray:
        """Return the number of measured samples of each row (R,)."""
        return np.bincount(self.row_of, minlength=self.rows.n_rows)

    @property
    def weights(self) -> FloatArray:
        """Return the weights (R, N) of the rows by their duration."""
        return np.repeat(self.rows.weights[:, None], self.y.shape[1], axis=1)

    @cached_property
    def white_noise(self) -> FloatArray:
        """Return the standard deviation (N,) in N·m of the white noise of a row's torque."""
        samples = self.samples
        within = samples.runs[2:] == samples.runs[:-2]
        if not within.any():
            return np.full(samples.n_joints, noise.floor(samples.tau))
        each = noise.of_second_differences(samples.tau, within)
        return np.maximum(each / np.sqrt(np.median(self.rows.count)),
                          self.options.discrepancy * self.scale.torque)

    def means(self, torque: FloatArray) -> JointSamples:
        """Return the means over rows as samples, with a torque (R, N) in N·m."""
        samples, rows = self.samples, self.rows
        return JointSamples(samples.names, rows.t, rows.mean(samples.q), rows.mean(samples.qd),
                            torque, rows.run, samples.run_labels)

    def factory(self, shared: Shared) -> TermFactory:
        """Return the factory of terms on this motion with the gravity of a shared part."""
        def motion_of() -> Motion:
            return self.motion.with_gravity(
                shared.gravity(self.samples.q), shared.gradient, getattr(shared, 'chain', None),
                getattr(shared, 'geometry', None))

        return TermFactory(motion_of, self.rows, self.scale, self.terms)


def _no_gradient(q: FloatArray) -> FloatArray:
    raise NotImplementedError('the gravity of this motion is not known yet')
