"""Effects of a model that pose and speed of this very moment tell, fast enough for a loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.predict import installed, joint_number
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import ModelMismatchError, OptionError
from gravity_comp_ros.models.applied_effects import AppliedEffect
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# Of these a moment tells the torque. Others look back (drift, presliding), need acceleration, or
# are about the measurement of gravity and not a torque of their own.
INSTANT = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'degressive_friction',
           'asymmetric_friction', 'load_dependent_friction', 'torque_offset', 'joint_spring',
           'cable_stiffness', 'torque_ripple')
# Of these a torque may be sent to the drives. An end stop, a ripple or a friction that differs by
# direction is nothing to push against blindly.
SAFE = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'degressive_friction',
        'load_dependent_friction', 'torque_offset', 'joint_spring', 'cable_stiffness')


@dataclass(frozen=True)
class CompensateOptions:
    """
    What of a model's effects is compensated, and how carefully.

    `fraction` of the torque is sent: all of a friction makes an arm slide by itself. Friction
    turns its sign over `speed` rad/s at least, and speeds count up to `top_speed` rad/s, beyond
    which nothing was learned.

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
    The torque of those effects of a model that a moment tells.

    :param only: the effects that count, as targets `NAME:JOINT`; None for all that there are.
    :param options: None for the torque as it is.
    """

    def __init__(self, model: GravityModel, only: Sequence[str] | None = None,
                 options: CompensateOptions | None = None) -> None:
        self.options = options
        self.left_out = tuple(effect.target for effect in model.applied.effects
                              if effect.name not in INSTANT)
        self._terms = [_term(model, effect) for effect in model.applied.effects
                       if effect.name in INSTANT and (only is None or effect.target in only)]
        n = model.n_joints
        width = model.applied.direction.get('width', np.full(n, np.inf))
        self._width = width if options is None else np.maximum(width, options.speed)
        self._model = model
        self._zeros = np.zeros((1, n)), np.zeros((1, n, n))

    @property
    def targets(self) -> tuple[str, ...]:
        """The effects that count, as `NAME:JOINT`."""
        return tuple(term.effect.target for term in self._terms)

    def torque(self, q: FloatArray, qd: FloatArray, gravity: FloatArray) -> FloatArray:
        """
        Return what they add to gravity (N,) in N·m.

        :param q: pose (N,) in rad. :param qd: speed (N,) in rad/s.
        :param gravity: the model's torque at that pose (N,) in N·m.
        """
        total = np.zeros(len(q))
        if not self._terms:
            return total
        if self.options is not None:
            qd = np.minimum(np.maximum(qd, -self.options.top_speed), self.options.top_speed)
        moment = JointSamples.single_sample(self._model.joints, q, qd)
        motion = Motion(moment, self._zeros[0], gravity[None], self._zeros[1], self._width,
                        self._model)
        for term in self._terms:
            total[term.joint] += term.torque(motion)
        return total if self.options is None else self.options.fraction * total


def compensable(texts: Sequence[str], joints: tuple[str, ...]) -> tuple[str, ...]:
    """
    Return the targets that texts like `coulomb_friction:elbow` ask to compensate.

    :raises OptionError: if an effect is unknown, or not one to compensate.
    """
    try:
        wanted = requests(texts, joints)
    except OptionError as problem:
        raise OptionError(f'parameter compensate: {problem}') from problem
    for request in wanted:
        if request.effect.name not in SAFE:
            raise OptionError(
                f'parameter compensate: {request.effect.name} is refused; only these can be '
                f'told from pose and speed alone and sent to a drive: {", ".join(SAFE)}')
    return tuple(request.target for request in wanted)


def _term(model: GravityModel, effect: AppliedEffect) -> _Term:
    """Return an effect, after it was asked for a torque once: a loop is no place for surprises."""
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
