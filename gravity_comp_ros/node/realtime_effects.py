"""Effects of a model sample by sample: in the prediction, the residual and the feed-forward."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.effect import Effect, Needs
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import law_of, smooth_sign, speed_law
from gravity_comp_ros.effects.predict import coefficients, installed, joint_number
from gravity_comp_ros.effects.presliding import LiveElement
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import ModelMismatchError, OptionError
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_gradient import gravity_gradient
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.messages import Reading
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.torque_source import Compensation
import numpy as np

# Weighted joints whose sum moves, and the distance in rad and the skew of its element.
_ElementKey = tuple[tuple[tuple[int, float], ...], float, float]


def smooth(effect: AppliedEffect, speed: float) -> AppliedEffect:
    """
    Return an effect whose friction changes its sign over at least `speed` in rad/s.

    Friction that persists at rest is compensated in motion only: a torque that remains where the
    arm has stopped would push it.
    """
    if not law_of(effect.setting):
        return effect
    others = {name: value for name, value in effect.setting.items()
              if name not in law_of(effect.setting)}
    law = {name: max(value, speed) for name, value in speed_law(effect.setting, speed).items()}
    return replace(effect, setting={**others, **law})


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


@dataclass(frozen=True, eq=False)
class _Term:
    """An effect of a model; `factors` (K,) are the coefficients in the order of its columns."""

    effect: Effect
    applied: AppliedEffect
    joint: int
    factors: FloatArray

    @classmethod
    def of(cls, model: GravityModel, applied: AppliedEffect, moment: Motion) -> _Term:
        """
        Return an effect after one evaluation, so that errors occur before the loop.

        :raises ModelMismatchError: if it was fitted by another version, or is not installed.
        """
        effect, joint = installed(applied), joint_number(model, applied)
        try:
            columns = effect.columns(moment, joint, applied.setting)
            return cls(effect, applied, joint,
                       coefficients(applied, effect, moment, joint, columns.shape[-1]))
        except (ModelMismatchError, AttributeError, LookupError, ValueError) as problem:
            raise ModelMismatchError(
                f'effect {applied.target} of the model was fitted by another version and is left '
                'out; fit it again') from problem

    def add_to(self, total: FloatArray, moment: Motion) -> None:
        """Add the torque to that of all joints (N,), N·m."""
        torque = self.effect.columns(moment, self.joint, self.applied.setting)[0] @ self.factors
        if self.effect.scope == 'arm':
            total += torque
        else:
            total[self.joint] += torque


class LiveEffects:
    """
    The torque of some effects of a model, sample by sample in order of time.

    Effects that need the history are left out (`left_out`, as targets). `problem` is the reason
    why others are.

    :param effects: effects of the model.
    :param limits: the parameters `compensate_fraction`, `compensate_speed` and `max_speed` if they
        are compensated: up to that speed the model was trained.
    """

    def __init__(self, model: GravityModel, effects: Iterable[AppliedEffect],
                 limits: Parameters | None = None) -> None:
        self._limits, self.problem = limits, ''
        self._model = model
        self._elements: dict[_ElementKey, LiveElement] = {}
        self._terms: list[_Term] = []
        left_out = []
        rest = np.zeros((3, model.n_joints))
        for applied in effects:
            try:
                if installed(applied).needs is Needs.HISTORY:
                    left_out.append(applied.target)
                    continue
                used = applied if limits is None else smooth(applied, limits.compensate_speed)
                self._terms.append(_Term.of(model, used, self._moment(*rest, elements={})))
            except ModelMismatchError as problem:
                self.problem = str(problem)
        self.left_out = tuple(left_out)

    @property
    def targets(self) -> tuple[str, ...]:
        """The included effects, as `NAME:JOINT`."""
        return tuple(term.applied.target for term in self._terms)

    def torque(self, q: FloatArray, qd: FloatArray, gravity: FloatArray,
               qdd: FloatArray | None = None) -> FloatArray:
        """
        Return the torque of the effects (N,) in N·m, in addition to gravity.

        :param q: pose (N,) in rad. :param qd: speed (N,) in rad/s.
        :param gravity: the model's torque at that pose (N,) in N·m.
        :param qdd: acceleration (N,) in rad/s^2; without one effects that need it are neglected.
        """
        total = np.zeros(len(q))
        if not self._terms:
            return total
        limits = self._limits
        if limits is not None:
            qd = np.minimum(np.maximum(qd, -limits.max_speed), limits.max_speed)
        moment = self._moment(q, qd, gravity, qdd, elements=self._elements)
        for term in self._terms:
            if qdd is not None or term.effect.needs is Needs.SPEED:
                term.add_to(total, moment)
        return total if limits is None else limits.compensate_fraction * total

    def _moment(self, q: FloatArray, qd: FloatArray, gravity: FloatArray,
                qdd: FloatArray | None = None, *,
                elements: dict[_ElementKey, LiveElement]) -> _Moment:
        model = self._model
        return _Moment(
            JointSamples.single_sample(model.joints, q, qd),
            (np.zeros_like(q) if qdd is None else qdd)[None], gravity[None],
            lambda poses: gravity_gradient(model, poses), model.chain, model.geometry,
            elements=elements)


def compensable(texts: Sequence[str], joints: tuple[str, ...]) -> tuple[str, ...]:
    """
    Return the targets of texts like `coulomb_friction:elbow`.

    :raises OptionError: if an effect is unknown or cannot be compensated.
    """
    try:
        requested = requests(texts, joints)
    except OptionError as problem:
        raise OptionError(f'parameter compensate: {problem}') from problem
    for request in requested:
        if not request.effect.is_compensable:
            allowed = [effect.name for effect in all_effects().values() if effect.is_compensable]
            raise OptionError(
                f'parameter compensate: {request.effect.name} is refused; only these depend on '
                f'pose and speed alone and may be sent to a drive: {", ".join(allowed)}')
    return tuple(request.target for request in requested)


class EffectsInUse:
    """
    Torque of the effects of a model in addition to gravity.

    `problem` gives the reason why an effect in the parameter `compensate` is not sent; empty if
    all are.

    :param model: the model in use, None before there is one.
    """

    def __init__(self, model: GravityModel | None, settings: Parameters) -> None:
        self.problem = ''
        self._model = model
        self._all: LiveEffects | None = None
        self._sent: LiveEffects | None = None
        if model is None or not model.applied.effects:
            if settings.compensate:
                self.problem = 'the model has no effect to compensate'
            return
        self._all = LiveEffects(model, model.applied.effects)
        self.problem = self._all.problem
        try:
            requested = compensable(settings.compensate, model.joints)
        except OptionError as problem:
            self.problem = str(problem)
            return
        sent = LiveEffects(model, [effect for effect in model.applied.effects
                                   if effect.target in requested], settings)
        self._sent = sent if sent.targets else None
        if requested and not sent.targets:
            self.problem = self.problem or 'the model has none of the effects to compensate'

    @property
    def sent(self) -> tuple[str, ...]:
        """The effects that are compensated, as `NAME:JOINT`."""
        return self._sent.targets if self._sent else ()

    def predicted(self, reading: Reading, gravity: FloatArray) -> FloatArray:
        """Return gravity (N,) in N·m plus all effects that depend on pose and speed alone."""
        if self._all is None or reading.qd is None:
            return gravity
        return gravity + self._all.torque(reading.q, reading.qd, gravity)

    def compensation(self) -> Compensation | None:
        """Return the torque to send in addition to gravity, None for none."""
        sent, model = self._sent, self._model
        if sent is None or model is None:
            return None

        def torque(q: FloatArray, qd: FloatArray | None) -> FloatArray | None:
            return None if qd is None else sent.torque(q, qd, model.predict_one(q))

        return torque
