"""The model in use: what the node computes from it for each message and each slow sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.live import Limits, LiveEffects
from gravity_comp_ros.effects.motion_direction import COMPENSATION_SPEED
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.effects.request import requests
from gravity_comp_ros.errors import DataError, OptionError
from gravity_comp_ros.evaluation.external_torque import ExternalTorque, ExternalTorqueObserver
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.messages import CompleteReading, Reading
from gravity_comp_ros.node.parameters import Parameters
from gravity_comp_ros.node.torque_source import Compensation, TorqueSource, UncertainChange
import numpy as np


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


class ModelInUse:
    """
    A model with its effects, sample by sample in order of time.

    `source` is the torque to publish, `compensated` the effects in it, as `NAME:JOINT`. `problem`
    is the reason why another effect of the parameter `compensate` is not sent, else empty.

    :param change: change from the previous payload where few samples determine it; none of it is
        used until `update_share` is called.
    """

    def __init__(self, model: GravityModel, settings: Parameters,
                 change: UncertainChange | None = None) -> None:
        self.model = model
        self._change = change
        self._share = np.zeros(model.n_joints)
        # Friction that persists at rest has a memory: one of the messages, one of the samples.
        self._effects, self._effects_of_samples = (
            LiveEffects(model, model.applied.effects) for _ in range(2))
        self._fitted = LiveEffects(model, model.fitted.effects)
        self._external: ExternalTorqueObserver | None = None
        self.source = TorqueSource.of(model)
        if change is not None:
            self.source = replace(self.source, predict=change.with_share(self._share))
        self.compensate(settings)

    def compensate(self, settings: Parameters) -> None:
        """Send the effects that the settings list."""
        model, requested = self.model, compensable(settings.compensate, self.model.joints)
        sent = LiveEffects(
            model, [effect for effect in model.applied.effects if effect.target in requested],
            Limits(settings.compensate_fraction, COMPENSATION_SPEED, settings.max_speed))
        self.compensated, self.problem = sent.targets, self._effects.problem
        if requested and not sent.targets and not self.problem:
            self.problem = 'the model has none of the effects to compensate'

        def torque(q: FloatArray, qd: FloatArray | None) -> FloatArray | None:
            return None if qd is None else sent.torque(q, qd, model.predict_one(q))

        effects: Compensation | None = torque if sent.targets else None
        self.source = replace(self.source, effects=effects)

    def update_share(self, q: FloatArray) -> bool:
        """
        Determine the share of an uncertain change at a pose q (N,); return whether it differs.

        `source` is then another one. This takes 0.2 ms.
        """
        if self._change is None:
            return False
        share = self._change.share(self.source.nearest(q))
        if np.array_equal(share, self._share):
            return False
        self._share = share
        self.source = replace(self.source, predict=self._change.with_share(share))
        return True

    def predicted(self, reading: Reading) -> FloatArray:
        """Return gravity (N,) in N·m plus all effects that depend on pose and speed alone."""
        gravity = self.model.predict_one(reading.q)
        if reading.qd is None:
            return gravity
        return gravity + self._effects.torque(reading.q, reading.qd, gravity)

    def residual(self, reading: CompleteReading, gravity: FloatArray,
                 qdd: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """
        Return measured minus predicted torque (N,) in N·m, and the same minus nuisance torque.

        A fit estimates friction, offset, inertia and other effects jointly with gravity, and the
        model does not predict them (`GravityModel.fitted`): the noise is that without them.

        :param gravity: the model's torque at the pose (N,), N·m.
        :param qdd: acceleration (N,) in rad/s^2; without one inertia is neglected.
        """
        motion = reading.q, reading.qd, gravity, qdd
        error = reading.tau - gravity - self._effects_of_samples.torque(*motion)
        return error, error - self._fitted.torque(*motion)

    def external_torque(self, reading: CompleteReading) -> ExternalTorque | None:
        """Return the external torque (N,) after a reading, None without a window of messages."""
        if self._external is None:
            self._external = ExternalTorqueObserver(self.model)
        return self._external.add(reading.t, reading.q, reading.qd, reading.tau)

    def distance(self, q: FloatArray) -> FloatArray:
        """Return the distance outside the trained range (N,), rad, modulo whole revolutions."""
        return self.model.coverage.distance(self.source.nearest(q))

    def std(self, q: FloatArray) -> FloatArray:
        """Return the standard deviation of the torque (N,) in N·m; empty if there is none."""
        try:
            return self.model.predict_std(q)[0]
        except (DataError, np.linalg.LinAlgError):
            return np.zeros(0)
