"""Regression of a fit: condensed samples, linear terms in addition to gravity, robust weights."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.acceleration import accelerations
from gravity_comp_ros.data.condense import Condensation, condense
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion_direction import Shape
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.inertia import Inertia, inertia_of
from gravity_comp_ros.estimation.nominal_motion import without_motion
from gravity_comp_ros.estimation.nuisance_columns import (
    build_columns, initial_shapes, NuisanceColumns)
from gravity_comp_ros.models.kinematic.chain_fit import NuisanceDesign
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.noise import floor
import numpy as np


@dataclass(frozen=True, eq=False)
class Regression:
    """
    Condensed samples, and the linear terms that are fitted jointly with gravity.

    `recorded` are the samples before condensing, `qdd` (M, N) their accelerations in rad/s^2, and
    `inertia` those of the inertia terms, None without any. `nuisance` are the columns of nuisance
    terms; `effects` (K, N, m) those of effects of the model. Effects replace the nuisance terms
    `excluded` (kind and joint number). `effect_std` (K,) are prior standard deviations of the
    effects' coefficients, per N·m of noise, inf for none; None if all are. `robust_weights`
    (m, N) are weights of squared residuals.
    """

    recorded: JointSamples
    condensation: Condensation
    samples: JointSamples
    nuisance: NuisanceColumns
    robust_weights: FloatArray
    qdd: FloatArray
    inertia: Inertia | None
    effects: FloatArray | None = None
    excluded: frozenset[tuple[str, int]] = frozenset()
    effect_std: FloatArray | None = None

    @property
    def n_effects(self) -> int:
        """Return the number of columns K of the effects."""
        return 0 if self.effects is None else len(self.effects)

    @property
    def has_coupled_inertia(self) -> bool:
        """Return whether every acceleration has a term in the torque of every joint."""
        return self.inertia is not None and self.inertia.is_coupled

    def linear_terms(self) -> NuisanceDesign:
        """Return the columns of effects and of nuisance terms, in this order, and the weights."""
        parts = [part for part in (self.effects, self.nuisance.dense()) if part is not None]
        weights = None if (self.robust_weights == 1.0).all() else self.robust_weights
        if not parts:
            return NuisanceDesign(None, weights)
        effect_std = np.full(self.n_effects, np.inf) if self.effect_std is None \
            else self.effect_std
        return NuisanceDesign(np.concatenate(parts), weights,
                              np.concatenate([effect_std, self.nuisance.prior_std]))

    def residual(self, gravity: FloatArray, coefficients: FloatArray) -> FloatArray:
        """Return the residual (m, N) in N·m of a gravity torque (m, N) and linear terms (K,)."""
        residual = self.samples.tau - gravity
        columns = self.linear_terms().columns
        if columns is None:
            return residual
        return np.asarray(residual - np.tensordot(coefficients, columns, axes=(0, 0)).T)

    def row_weights(self, residual: FloatArray) -> FloatArray:
        """Return one over the noise std (m, N) of each row, from a residual (m, N) in N·m."""
        sigma = np.maximum(np.sqrt((self.robust_weights * residual ** 2).mean(axis=0)), 1e-12)
        return np.asarray(np.sqrt(self.robust_weights) / sigma)

    def with_shapes(self, shapes: tuple[Shape, ...]) -> Regression:
        """Return the same with other friction shapes and all identifiable nuisance columns."""
        columns = build_columns(self.recorded, shapes, self.condensation, self.inertia,
                                self.effects, self.excluded)
        return replace(self, nuisance=columns)

    def with_terms(self, selected: list[int]) -> Regression:
        """Return the same with some of the nuisance columns."""
        return replace(self, nuisance=self.nuisance.select(selected))

    def reweighted(self, residual: FloatArray) -> Regression:
        """Return the same with robust weights from a residual (m, N) in N·m."""
        return replace(self, robust_weights=robust.huber_weights(residual,
                                                                 floor(self.samples.tau)))

    def thinned(self, max_samples: int) -> Regression:
        """Return the regression of some condensed samples, evenly spread along the path."""
        m = self.samples.n_samples
        step = -(-m // max_samples)
        return self if step <= 1 else self.select(np.arange(m) % step == 0)

    def select(self, keep: np.ndarray) -> Regression:
        """Return the regression of some of the condensed samples (mask (m,))."""
        columns = replace(self.nuisance, values=self.nuisance.values[:, keep])
        effects = None if self.effects is None else self.effects[:, :, keep]
        return replace(self, samples=self.samples.select(keep), nuisance=columns,
                       robust_weights=self.robust_weights[keep], effects=effects)


def build_regression(samples: JointSamples, effects: FloatArray | None = None,
                     condensation: Condensation | None = None,
                     excluded: frozenset[tuple[str, int]] = frozenset(),
                     effect_std: FloatArray | None = None,
                     geometry: Geometry | None = None) -> Regression:
    """
    Return the regression of samples with all identifiable nuisance columns.

    Slow motion has inertia terms if the accelerations of the samples are known.

    :param effects: columns (K, N, m) of effects, condensed by `condensation`.
    :param condensation: of the samples; None computes it.
    :param excluded: kinds and joint numbers of nuisance terms that effects replace.
    :param effect_std: (K,) as in `Regression`.
    :param geometry: known axes: the dynamic torque of a nominal arm is subtracted first.
    """
    condensation = condensation or condense(samples)
    has_own_inertia = samples.qdd is not None and geometry is None
    qdd = accelerations(samples)
    every = inertia_of(samples, qdd)
    inertia = every if every.is_coupled or has_own_inertia else None
    if geometry is not None:
        samples = without_motion(samples, geometry, qdd)
    columns = build_columns(samples, initial_shapes(samples), condensation, inertia, effects,
                            excluded)
    condensed = condensation.samples(samples)
    return Regression(samples, condensation, condensed, columns, np.ones(condensed.q.shape), qdd,
                      inertia, effects, excluded, effect_std)
