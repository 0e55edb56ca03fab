"""Effects of a model that the node predicts and compensates."""

from __future__ import annotations

from collections.abc import Sequence

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.live import Limits, LiveEffects
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.messages import Reading
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.torque_source import Compensation


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
                                   if effect.target in requested],
                           Limits(settings.compensate_fraction, settings.compensate_speed,
                                  settings.max_speed))
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
