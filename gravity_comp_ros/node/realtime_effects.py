"""Effects of a model from the present pose and speed, in the prediction and the feed-forward."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.predict import installed, joint_number
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import GravityCompError, ModelMismatchError, OptionError
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.messages import Reading
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.torque_source import Compensation
import numpy as np

# Effects whose torque depends on pose and speed alone. The others depend on history (drift,
# presliding) or acceleration, or describe the measurement and are no torque of their own.
INSTANTANEOUS = (
    'coulomb_friction', 'viscous_friction', 'stribeck_friction', 'degressive_friction',
    'asymmetric_friction', 'load_dependent_friction', 'torque_offset', 'joint_spring',
    'cable_stiffness', 'torque_ripple')
# Those whose torque may be sent to the drives. Compensation of an end stop, a ripple or an
# asymmetric friction is not safe.
COMPENSABLE = (
    'coulomb_friction', 'viscous_friction', 'stribeck_friction', 'degressive_friction',
    'load_dependent_friction', 'torque_offset', 'joint_spring', 'cable_stiffness')


@dataclass(frozen=True)
class CompensateOptions:
    """
    Limits of the compensation of effects.

    `fraction` of the torque is sent; with the whole friction an arm may drift on its own. Friction
    changes its sign over at least `speed` rad/s. Speeds are clipped to `top_speed` rad/s, up to
    which the model was trained.

    :raises OptionError: if a number is out of range.
    """

    fraction: float = 0.7
    speed: float = 0.02
    top_speed: float = 0.15

    def __post_init__(self) -> None:
        if not 0.0 <= self.fraction <= 1.0:
            raise OptionError(f'compensation: fraction is {self.fraction}; it must be 0 to 1')
        if not (0.0 < self.speed < np.inf and 0.0 < self.top_speed < np.inf):
            raise OptionError('compensation: speeds must be positive')


@dataclass(frozen=True, eq=False)
class _Term:
    effect: AppliedEffect
    joint: int
    coefficients: FloatArray

    def torque(self, motion: Motion) -> float:
        columns = installed(self.effect).columns(motion, self.joint, self.effect.setting)
        return float(columns[0] @ self.coefficients)


class InstantEffects:
    """
    The torque of the effects of a model that depend on pose and speed alone.

    :param only: the effects to include, as targets `NAME:JOINT`; None for all.
    :param options: limits of a compensation; None for the unchanged torque.
    """

    def __init__(self, model: GravityModel, only: Sequence[str] | None = None,
                 options: CompensateOptions | None = None) -> None:
        self.options = options
        self.left_out = tuple(effect.target for effect in model.applied.effects
                              if effect.name not in INSTANTANEOUS)
        self._terms = [_term(model, effect) for effect in model.applied.effects
                       if effect.name in INSTANTANEOUS and (only is None or effect.target in only)]
        n = model.n_joints
        width = model.applied.direction.get('width', np.full(n, np.inf))
        self._width = width if options is None else np.maximum(width, options.speed)
        self._ramp = model.applied.direction.get('ramp')
        self._model = model
        self._zeros = np.zeros((1, n)), np.zeros((1, n, n))

    @property
    def targets(self) -> tuple[str, ...]:
        """The included effects, as `NAME:JOINT`."""
        return tuple(term.effect.target for term in self._terms)

    def torque(self, q: FloatArray, qd: FloatArray, gravity: FloatArray) -> FloatArray:
        """
        Return the torque of the effects (N,) in N·m, in addition to gravity.

        :param q: pose (N,) in rad.
        :param qd: speed (N,) in rad/s.
        :param gravity: the model's torque at that pose (N,) in N·m.
        """
        total = np.zeros(len(q))
        if not self._terms:
            return total
        if self.options is not None:
            qd = np.minimum(np.maximum(qd, -self.options.top_speed), self.options.top_speed)
        sample = JointSamples.single_sample(self._model.joints, q, qd)
        motion = Motion(sample, self._zeros[0], gravity[None], self._zeros[1], self._width,
                        self._model, ramp=self._ramp)
        for term in self._terms:
            total[term.joint] += term.torque(motion)
        return total if self.options is None else self.options.fraction * total


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
        if request.effect.name not in COMPENSABLE:
            raise OptionError(
                f'parameter compensate: {request.effect.name} is refused; only these depend on '
                f'pose and speed alone and may be sent to a drive: {", ".join(COMPENSABLE)}')
    return tuple(request.target for request in requested)


def _term(model: GravityModel, effect: AppliedEffect) -> _Term:
    """Return an effect after one evaluation, so that errors occur before the loop."""
    n, joint = model.n_joints, joint_number(model, effect)
    pose = np.zeros((1, n))
    motion = Motion(JointSamples.single_sample(model.joints, pose[0], pose[0]), pose, pose,
                    np.zeros((1, n, n)), np.ones(n), model)
    try:
        symbols = [c.symbol for c in
                   installed(effect).coefficients_of(motion, joint, effect.setting)]
        term = _Term(effect, joint, np.array([effect.coefficients[symbol].value
                                              for symbol in symbols]))
        term.torque(motion)
    except (AttributeError, LookupError, ValueError) as problem:
        raise ModelMismatchError(
            f'effect {effect.target} of the model was fitted by another version and is left out; '
            'fit it again') from problem
    return term


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
        self._all: InstantEffects | None = None
        self._sent: InstantEffects | None = None
        if model is None or not model.applied.effects:
            if settings.compensate:
                self.problem = 'the model has no effect to compensate'
            return
        try:
            requested = compensable(settings.compensate, model.joints)
            every = InstantEffects(model)
            sent = InstantEffects(model, requested, CompensateOptions(
                settings.compensate_fraction, settings.compensate_speed, settings.max_speed))
        except GravityCompError as problem:
            self.problem = str(problem)
            return
        self._all = every if every.targets else None
        self._sent = sent if sent.targets else None
        if requested and not sent.targets:
            self.problem = 'the model has none of the effects to compensate'

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
