"""
Regressors of an effect and of what could be taken for it, along recorded and planned motion.

Rows are whitened: each counts by the noise and the autocorrelation that were measured. Nuisance
terms stand beside the effect: gravity's own parameters, Coulomb and viscous friction, offset and
inertia of each joint. Their information matrix is all that is kept of a motion, and those of
several motions add.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.sparse.regressor import EnergyDesign
from gravity_comp_ros.planning.segments import sampled, Segment
import numpy as np

# Columns of a joint's own nuisance terms, by the effect that each of them is.
_OWN = ('coulomb_friction', 'viscous_friction', 'torque_offset')
# What is known of gravity before any data: axes to 0.3 rad, moments to their own size.
_AXIS_SPREAD = 0.3


@dataclass(frozen=True)
class Alternative:
    """An effect on a joint (None: the whole arm) with one setting."""

    effect: Effect
    joint: int | None
    setting: Setting

    @property
    def key(self) -> tuple[str, int | None]:
        return self.effect.name, self.joint


@dataclass(frozen=True)
class Question:
    """
    An effect to settle, and what explains the same.

    `size` (K,) are the coefficients that the effect is taken to have. `joints` are those on
    whose torque it is judged.
    """

    target: Alternative
    alternatives: tuple[Alternative, ...]
    size: FloatArray
    joints: tuple[int, ...]
    known_size: bool


@dataclass(frozen=True, eq=False)
class NoiseRate:
    """
    What a second of motion is worth: `per_second` (N,) in 1/(N·m)².

    One over the variance of the residual, for every correlation time of it.
    """

    per_second: FloatArray


@dataclass(frozen=True, eq=False)
class Situation:
    """The recorded motion as effects see it, the model, and the noise."""

    recorded: Motion
    model: GravityModel
    noise: NoiseRate
    rate: float
    memo: dict[str, FloatArray] = field(default_factory=dict, repr=False)

    @property
    def n_joints(self) -> int:
        return self.recorded.samples.n_joints

    def planned(self, segments: list[Segment] | tuple[Segment, ...],
                gradient: bool = False) -> Motion:
        """Return a planned motion as effects will see it, its torque as predicted."""
        t, (q, qd, qdd) = sampled(segments, self.rate)
        gravity = self.model.predict(q)
        samples = JointSamples.single_run(self.recorded.samples.names, t, q, qd, gravity)
        n = self.n_joints
        slopes = gravity_gradient(self.model, q) if gradient else np.zeros((len(q), n, n))
        return Motion(samples, qdd, gravity, slopes, self.recorded.sign_width, self.model,
                      self.recorded.hold)

    def information(self, question: Question, motion: Motion, seconds: float) -> FloatArray:
        """
        Return the information matrix (P, P) of nuisance terms and the question's effects.

        Gravity and each joint's nuisance terms come first, then the target's columns, then those
        of each alternative.

        :param seconds: the time that a row stands for.
        """
        total: FloatArray | None = None
        gravity = self._gravity(motion)
        effects = [one.effect.columns_of_arm(motion, one.joint or 0, one.setting)
                   for one in (question.target, *question.alternatives)]
        every = np.concatenate(effects, axis=2)
        for place, n in enumerate(question.joints):
            own = _own(question, motion, n)
            blocks = np.zeros((len(own), len(question.joints), own.shape[1]))
            blocks[:, place] = own
            rows = np.column_stack([gravity[:, n], blocks.reshape(len(own), -1), every[:, n]])
            part = (rows.T @ rows) * (seconds * self.noise.per_second[n])
            total = part if total is None else total + part
        if total is None:
            raise OptionError('plan: a question about no joint')
        return total

    def prior(self, question: Question) -> FloatArray:
        """Return what is known of gravity and nuisance terms before any data, (P,)."""
        gravity = 1.0 / self._gravity_spread() ** 2
        own = np.full(len(question.joints) * self._n_own(question), 1e-6)
        return np.concatenate([gravity, own])

    def _n_own(self, question: Question) -> int:
        return sum(name != question.target.effect.name for name in _OWN) + self.n_joints

    def _gravity(self, motion: Motion) -> FloatArray:
        """Return how gravity changes with its parameters, (M, N, K), kept with the motion."""
        if 'gravity parameters' not in motion.memo:
            motion.memo['gravity parameters'] = _gravity_columns(self.model, motion.samples.q)
        return motion.memo['gravity parameters']

    def _gravity_spread(self) -> FloatArray:
        if 'spread' not in self.memo:
            self.memo['spread'] = _gravity_spread(self.model)
        return self.memo['spread']


def _gravity_columns(model: GravityModel, q: FloatArray) -> FloatArray:
    if model.chain is not None:
        # The first two turn the base: a tilted base is an effect of its own.
        return model.chain.jacobian(q).transpose(2, 1, 0)[:, :, 2:]
    if model.energy is None:
        raise OptionError('plan needs a model with an energy: fit a chain or a potential')
    design = EnergyDesign(q, np.ones_like(q))
    columns = np.asarray(design.columns(model.energy.indices))
    return columns.reshape(model.n_joints, len(q), -1).transpose(1, 0, 2)


def _gravity_spread(model: GravityModel) -> FloatArray:
    if model.chain is not None:
        n = model.n_joints
        largest = max(float(np.abs(model.chain.moments).max()), 1e-3)
        return np.concatenate([np.full(2 * n - 2, _AXIS_SPREAD), np.full(2 * n, largest)])
    if model.energy is None:
        raise OptionError('plan needs a model with an energy: fit a chain or a potential')
    largest = max(float(np.abs(model.energy.weights).max(initial=0.0)), 1e-3)
    return np.full(len(model.energy.indices), largest)


def _own(question: Question, motion: Motion, joint: int) -> FloatArray:
    """Return a joint's nuisance columns (M, K) without the target's own."""
    qd = motion.samples.qd[:, joint]
    every = {'coulomb_friction': motion.direction(joint), 'viscous_friction': qd,
             'torque_offset': np.ones(len(qd))}
    kept = [column for name, column in every.items() if name != question.target.effect.name]
    return np.column_stack([*kept, motion.qdd])


def width(one: Alternative, motion: Motion) -> int:
    """Return how many columns an effect has."""
    return int(one.effect.columns(motion, one.joint or 0, one.setting).shape[-1])
