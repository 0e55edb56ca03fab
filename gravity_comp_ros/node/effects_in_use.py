"""Effects of the model in use, in the prediction and in the feed-forward."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import GravityCompError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.messages import Reading
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.realtime_effects import compensable, CompensateOptions, InstantEffects


class EffectsInUse:
    """
    Torque of the effects of a model in addition to gravity.

    `problem` gives the reason why an effect in the parameter `compensate` is not sent; empty if
    all are.

    :param model: the model in use, None before there is one.
    """

    def __init__(self, model: GravityModel | None, settings: Parameters) -> None:
        self.problem = ''
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

    def compensation(self, model: GravityModel | None, reading: Reading) -> FloatArray | None:
        """Return the torque (N,) in N·m to send in addition to gravity, None for none."""
        if self._sent is None or model is None or reading.qd is None:
            return None
        return self._sent.torque(reading.q, reading.qd, model.predict_one(reading.q))
