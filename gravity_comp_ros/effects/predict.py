"""
Torque prediction of a model with its effects.

    tau = g(q) + sum_e X_e(q, qd, qdd, g, t; setting_e) c_e

X_e are the columns of effect e, c_e its coefficients. Some columns depend on earlier samples
(acceleration, presliding), so predict all recorded samples and select some afterwards. A control
loop reads the effects sample by sample in order of time (`LiveEffects`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.poses import batches
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Effect, Needs
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import LiveElement, smooth_sign
from gravity_comp_ros.effects.registry import all_effects, broken_plug_ins
from gravity_comp_ros.errors import ModelMismatchError
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.printable import printable
import numpy as np

# Weighted joints whose sum moves, and the distance in rad and the skew of its element.
_ElementKey = tuple[tuple[tuple[int, float], ...], float, float]


def predict_torque(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return the predicted torque (M, N) in N·m of the samples' motion.

    Joints are matched by name and returned in the model's order.

    :raises ModelMismatchError: if a joint of the model is not among the samples, or an effect of
        the model is not installed.
    """
    samples = samples.joints(model.joints)
    gravity = model.predict(samples.q)
    if not model.applied.effects:
        return gravity
    return gravity + effect_torque(model, samples, gravity)


def effect_torque(model: GravityModel, samples: JointSamples,
                  gravity: FloatArray | None = None) -> FloatArray:
    """
    Return the torque (M, N) in N·m of the model's effects, without gravity.

    :param gravity: the model's gravity torque (M, N) in N·m, if known.
    :raises ModelMismatchError: as `predict_torque`.
    """
    return torque_of(model, model.applied.effects, samples, gravity)


def fitted_torque(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return the torque (M, N) in N·m of the effects that were fitted and are not predicted.

    :raises ModelMismatchError: as `predict_torque`.
    """
    return torque_of(model, model.fitted.effects, samples)


def static_torque(model: GravityModel, samples: JointSamples) -> FloatArray:
    """
    Return the torque (M, N) in N·m that holds the arm: gravity and all static effects found.

    :raises ModelMismatchError: as `predict_torque`.
    """
    samples = samples.joints(model.joints)
    gravity = model.predict(samples.q)
    return gravity + torque_of(model, static_effects(
        (*model.applied.effects, *model.fitted.effects)), samples, gravity)


def static_std(model: GravityModel, q: FloatArray,
               effects: Iterable[AppliedEffect] | None = None) -> FloatArray:
    """
    Return the standard deviation (M, N) in N·m of gravity plus static effects at q (M, N) in rad.

    Where the motion does not separate them, their sum is more certain than either.

    :param effects: effects of the model, of which the static ones count; by default the predicted.
    :raises DataError: if the model has no uncertainty.
    :raises ModelMismatchError: as `predict_torque`.
    """
    static = static_effects(model.applied.effects if effects is None else effects)
    return np.concatenate([np.zeros((0, model.n_joints)), *(
        np.sqrt((_static_deviations(model, q[rows], static) ** 2).sum(axis=0))
        for rows in batches(len(q)))])


def _static_deviations(model: GravityModel, q: FloatArray,
                       effects: Iterable[AppliedEffect]) -> FloatArray:
    """Return the changes (K, M, N) in N·m of gravity plus effects by the errors of the model."""
    deviations = model.deviations(q)
    motion = motion_of(model, JointSamples.at_rest(model.joints, q))
    for applied in effects:
        columns = EffectInUse.of(model, applied, motion).columns(motion)
        deviations += np.tensordot(model.coefficient_errors(applied).T, columns, 1)
    return deviations


def static_effects(effects: Iterable[AppliedEffect]) -> list[AppliedEffect]:
    """Return the installed effects that hold the arm at rest."""
    known = all_effects()
    return [each for each in effects if each.name in known and known[each.name].is_static]


def torque_of(model: GravityModel, effects: Iterable[AppliedEffect], samples: JointSamples,
              gravity: FloatArray | None = None) -> FloatArray:
    """Return the torque (M, N) in N·m of some effects of a model, without gravity."""
    samples, effects = samples.joints(model.joints), tuple(effects)
    total = np.zeros_like(samples.q)
    if effects and samples.n_samples:
        motion = motion_of(model, samples, gravity)
        for applied in effects:
            EffectInUse.of(model, applied, motion).add_to(total, motion)
    return total


def motion_of(model: GravityModel, samples: JointSamples,
              gravity: FloatArray | None = None) -> Motion:
    """Return the motion from which the columns of a model's effects are computed."""
    torque = model.predict(samples.q) if gravity is None else gravity
    return Motion.of(samples, torque, lambda q: gravity_gradient(model, q), model.chain,
                     model.geometry)


@dataclass(frozen=True, eq=False)
class EffectInUse:
    """
    An effect of a model with that of the library or a plug-in.

    `joint` is the number for its methods, 0 for the whole arm; `symbols` and `factors` (K,) are
    the coefficients in the order of its columns.
    """

    effect: Effect
    applied: AppliedEffect
    joint: int
    symbols: tuple[str, ...]
    factors: FloatArray

    @classmethod
    def of(cls, model: GravityModel, applied: AppliedEffect, motion: Motion) -> EffectInUse:
        """
        Return an effect of a model.

        :raises ModelMismatchError: if it is not installed, or has other coefficients.
        """
        effect = all_effects().get(applied.name)
        if effect is None:
            broken = broken_plug_ins()
            why = f' ({broken[0]})' if broken else ''
            raise ModelMismatchError(f'the model has an effect {printable(applied.name)} that is '
                                     f'not installed here{why}: install the package that '
                                     f'provides it, or remove it (`gravity_comp add --undo`)')
        joint = 0 if applied.joint is None else model.joints.index(applied.joint)
        symbols = tuple(c.symbol for c in effect.coefficients_of(motion, joint, applied.setting))
        if set(symbols) != set(applied.coefficients):
            raise ModelMismatchError(
                f'the model has {applied.target} with the coefficients '
                f'{", ".join(applied.coefficients)}, but the installed version has '
                f'{", ".join(symbols)}. Remove the effect and add it again')
        return cls(effect, applied, joint, symbols,
                   np.array([applied.coefficients[symbol].value for symbol in symbols]))

    def torque(self, motion: Motion) -> FloatArray:
        """Return the torque in N·m, (M, N) of all joints or (M,) of one (`Effect.torque`)."""
        return self.effect.torque(motion, self.joint, self.applied.setting, self.factors)

    def columns(self, motion: Motion) -> FloatArray:
        """Return the torque (K, M, N) in N·m of all joints by each coefficient of 1 alone."""
        result = np.zeros((len(self.factors), *motion.samples.q.shape))
        for unit, torque in zip(np.eye(len(self.factors)), result):
            replace(self, factors=unit).add_to(torque, motion)
        return result

    @property
    def joints(self) -> slice | int:
        """Return the joints on which it acts."""
        return slice(None) if self.effect.scope == 'arm' else self.joint

    def add_to(self, total: FloatArray, motion: Motion) -> None:
        """Add the torque to that of all joints (M, N), N·m."""
        total[:, self.joints] += self.torque(motion)


@dataclass(frozen=True)
class _Moment(Motion):
    """A motion of one sample, whose directions by a distance follow from the earlier ones."""

    elements: dict[_ElementKey, LiveElement] = field(default_factory=dict)

    def coupled_direction(self, joints: Mapping[int, float],
                          law: Mapping[str, float]) -> FloatArray:
        """Return the direction (1,) of a sum of joints, each times a factor."""
        if 'distance' not in law:
            return smooth_sign(self._sum(self.samples.qd, joints), law)
        distance, skew = law['distance'], law.get('skew', 0.0)
        key = (tuple(joints.items()), distance, skew)
        # Two effects of a joint may share an element: it is read once in each sample.
        if key not in self.memo:
            if key not in self.elements:
                self.elements[key] = LiveElement(distance, skew)
            angle = float(self._sum(self.samples.q, joints)[0])
            self.memo[key] = np.array([self.elements[key].state(angle)])
        return self.memo[key]


class LiveEffects:
    """
    The torque of some effects of a model, sample by sample in order of time.

    Effects that need the history are left out (`left_out`, as targets). `problem` is the reason
    why others are.

    :param effects: effects of the model.
    """

    def __init__(self, model: GravityModel, effects: Iterable[AppliedEffect]) -> None:
        self._model, self.problem = model, ''
        self._elements: dict[_ElementKey, LiveElement] = {}
        self._effects: list[EffectInUse] = []
        left_out, rest = [], np.zeros((3, model.n_joints))
        for applied in effects:
            moment = self._moment(*rest, elements={})
            try:
                effect = EffectInUse.of(model, applied, moment)
                if effect.effect.needs is Needs.HISTORY:
                    left_out.append(applied.target)
                    continue
                effect.torque(moment)  # errors occur before the loop
                self._effects.append(effect)
            # A plug-in may raise any error; a control loop must not end by it.
            except Exception as problem:  # noqa: B902
                reason = printable(problem) or type(problem).__name__
                self.problem = f'effect {applied.target} of the model is left out: {reason}'
        self.left_out = tuple(left_out)

    @property
    def targets(self) -> tuple[str, ...]:
        """The included effects, as `NAME:JOINT`."""
        return tuple(effect.applied.target for effect in self._effects)

    def torque(self, q: FloatArray, qd: FloatArray, gravity: FloatArray,
               qdd: FloatArray | None = None) -> FloatArray:
        """
        Return the torque of the effects (N,) in N·m, in addition to gravity.

        :param q: pose (N,) in rad. :param qd: speed (N,) in rad/s.
        :param gravity: the model's torque at that pose (N,) in N·m.
        :param qdd: acceleration (N,) in rad/s^2; without one effects that need it are neglected.
        """
        total = np.zeros((1, len(q)))
        if self._effects:
            moment = self._moment(q, qd, gravity, qdd, elements=self._elements)
            for each in self._effects:
                if qdd is not None or each.effect.needs is Needs.SPEED:
                    each.add_to(total, moment)
        return total[0]

    def _moment(self, q: FloatArray, qd: FloatArray, gravity: FloatArray,
                qdd: FloatArray | None = None, *,
                elements: dict[_ElementKey, LiveElement]) -> _Moment:
        model = self._model
        return _Moment(
            JointSamples.single_sample(model.joints, q, qd),
            (np.zeros_like(q) if qdd is None else qdd)[None], gravity[None],
            lambda poses: gravity_gradient(model, poses), model.chain, model.geometry,
            elements=elements)
