"""What a fit is made of: condensed samples, columns beside gravity, and trust in samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.condense import Condensation, condense, CondenseOptions
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.data.velocity_check import checked_velocity
from gravity_comp_ros.effects.motion import accelerations
from gravity_comp_ros.effects.motion_direction import Shape
from gravity_comp_ros.effects.predict import rows_of
from gravity_comp_ros.estimation import robust
from gravity_comp_ros.estimation.nominal_motion import without_motion
from gravity_comp_ros.estimation.nuisance_columns import (
    build_columns, NuisanceColumns, plain_shapes)
from gravity_comp_ros.models.kinematic.chain_fit import Beside
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.noise import floor
import numpy as np

# rad/s. Recordings whose joints are faster for a tenth of the time have inertia in their torque.
_FAST, _FAST_SHARE = 0.2, 0.1
# rad/s^2. So do recordings in which they start and stop like this for a fiftieth of the time.
_UNEVEN, _UNEVEN_SHARE = 0.3, 0.02


@dataclass(frozen=True, eq=False)
class Regression:
    """
    Samples to fit, condensed, and the columns that are fitted beside gravity.

    `recorded` are the samples before condensing, `qdd` (M, N) their accelerations in rad/s^2, and
    `accelerated` says whether inertia is fitted. `nuisance` are the columns of nuisance terms;
    `effects` (K, N, m) those of effects that the model is to have. Effects take the place of the
    nuisance terms `excluded` (kind and joint number). `usual` (K,) are standard deviations of the
    effects' coefficients before any data, per N·m of noise, inf where they are free. `trust`
    (m, N) weighs squared residuals.
    """

    recorded: JointSamples
    means: Condensation
    samples: JointSamples
    nuisance: NuisanceColumns
    trust: FloatArray
    qdd: FloatArray
    accelerated: bool
    effects: FloatArray | None = None
    excluded: frozenset[tuple[str, int]] = frozenset()
    usual: FloatArray | None = None

    @property
    def n_effects(self) -> int:
        """Return how many columns K the effects have."""
        return 0 if self.effects is None else len(self.effects)

    def beside(self) -> Beside:
        """Return all columns beside gravity, those of effects first, and the trust."""
        parts = [part for part in (self.effects, self.nuisance.dense()) if part is not None]
        trust = None if (self.trust == 1.0).all() else self.trust
        if not parts:
            return Beside(None, trust)
        spread = np.concatenate([self._spread(), self.nuisance.spread])
        return Beside(np.concatenate(parts), trust, spread)

    def _spread(self) -> FloatArray:
        """Return the spread (K,) of the effects' coefficients before any data."""
        return np.full(self.n_effects, np.inf) if self.usual is None else self.usual

    def residual(self, gravity: FloatArray, coefficients: FloatArray) -> FloatArray:
        """Return what a gravity torque (m, N) and coefficients (K,) beside it leave, N·m."""
        left = self.samples.tau - gravity
        columns = self.beside().columns
        if columns is None:
            return left
        return np.asarray(left - np.tensordot(coefficients, columns, axes=(0, 0)).T)

    def row_weights(self, residual: FloatArray) -> FloatArray:
        """Return the weight (m, N) of each row, in units of the noise that a fit leaves (m, N)."""
        sigma = np.maximum(np.sqrt((self.trust * residual ** 2).mean(axis=0)), 1e-12)
        return np.asarray(np.sqrt(self.trust) / sigma)

    def with_shapes(self, shapes: tuple[Shape, ...]) -> Regression:
        """Return the same with other directions of motion; all nuisance columns come back."""
        qdd = self.qdd if self.accelerated else None
        columns = build_columns(self.recorded, shapes, self.means, qdd, self.effects,
                                self.excluded)
        return replace(self, nuisance=columns)

    def with_terms(self, kept: list[int]) -> Regression:
        """Return the same with some of the nuisance columns."""
        return replace(self, nuisance=self.nuisance.select(kept))

    def trusting(self, residual: FloatArray) -> Regression:
        """Return the same with samples trusted as a residual (m, N) in N·m asks for."""
        return replace(self, trust=robust.huber_weights(residual, floor(self.samples.tau)))

    def thinned(self, most: int) -> Regression:
        """Return at most `most` of the condensed samples, evenly spread along the path."""
        m = self.samples.n_samples
        step = -(-m // most)
        return self if step <= 1 else self.select(np.arange(m) % step == 0)

    def select(self, keep: np.ndarray) -> Regression:
        """Return the regression of some of the condensed samples (mask (m,))."""
        columns = replace(self.nuisance, values=self.nuisance.values[:, keep])
        effects = None if self.effects is None else self.effects[:, :, keep]
        return replace(self, samples=self.samples.select(keep), nuisance=columns,
                       trust=self.trust[keep], effects=effects)


def build_regression(samples: JointSamples, options: CondenseOptions = CondenseOptions(),
                     qdd: FloatArray | None = None, effects: FloatArray | None = None,
                     means: Condensation | None = None,
                     excluded: frozenset[tuple[str, int]] = frozenset(),
                     usual: FloatArray | None = None,
                     geometry: Geometry | None = None) -> Regression:
    """
    Return the regression of samples with all nuisance columns that the motion can identify.

    :param qdd: accelerations (M, N) in rad/s^2; None computes them. Inertia is fitted beside
        gravity where they show it.
    :param effects: columns (K, N, m) of effects, condensed by `means`.
    :param means: how the samples are condensed, if that is decided already.
    :param excluded: kinds and joint numbers of nuisance terms that effects take the place of.
    :param usual: (K,) as in `Regression`; None if all are free.
    :param geometry: the axes, if they are known: the torque of motion of a nominal arm is then
        taken off.
    """
    means = means or condense(samples, options)
    qdd = accelerations(samples) if qdd is None else qdd
    accelerated = _shows_inertia(samples, qdd)
    if geometry is not None:
        samples = without_motion(samples, geometry, qdd)
    columns = build_columns(samples, plain_shapes(samples), means, qdd if accelerated else None,
                            effects, excluded)
    condensed = means.samples(samples)
    return Regression(samples, means, condensed, columns, np.ones(condensed.q.shape), qdd,
                      accelerated, effects, excluded, usual)


def recorded_accelerations(samples: JointSamples, part: JointSamples) -> FloatArray | None:
    """
    Return accelerations (M, N) in rad/s^2 of `part`, from all samples; None where its own serve.

    Samples that passed the gate are far apart, which smooths what starts and stops quickly.

    :param part: a selection of the samples.
    """
    if len(part) == len(samples) or not uneven(part):
        return None
    return accelerations(checked_velocity(samples)[0])[rows_of(samples, part)]


def _shows_inertia(samples: JointSamples, qdd: FloatArray) -> bool:
    """
    Return whether motion is fast or uneven.

    A few poses that are reached and left quickly would be set aside as outliers without inertia,
    and they may be the only ones that show an axis.
    """
    uneven = (np.abs(qdd) > _UNEVEN).any(axis=1)
    return is_fast(samples) or bool(uneven.mean() > _UNEVEN_SHARE)


def uneven(samples: JointSamples) -> bool:
    """Return whether samples are of fast motion, or of slow motion that changes quickly."""
    return _shows_inertia(samples, accelerations(samples))


def is_fast(samples: JointSamples) -> bool:
    """Return whether joints are so fast for a tenth of the time that inertia shows."""
    return bool((np.abs(samples.qd) > _FAST).any(axis=1).mean() > _FAST_SHARE)
