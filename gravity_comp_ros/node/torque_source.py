"""The model in use: torque for the feed-forward, its effects, and residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.data.short_vectors import all_finite
from gravity_comp_ros.effects.live import Limits, LiveEffects
from gravity_comp_ros.effects.motion_direction import COMPENSATION_SPEED
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.evaluation.external_torque import (
    ExternalTorque, ExternalTorqueObserver, ExternalTorqueOptions)
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.node.messages import CompleteReading, Reading
from gravity_comp_ros.node.options import NODE
from gravity_comp_ros.node.parameters import Parameters
import numpy as np

REVOLUTION = 2.0 * math.pi
# Largest extrapolation of a per_joint model, rad. Such torques share no energy; a radian outside
# the trained range their errors are hundreds of N·m.
PER_JOINT_REACH = ExternalTorqueOptions().margin


@dataclass(frozen=True, eq=False)
class TorqueSource:
    """
    A model for the feed-forward: predict (N,) → (N,), and its trained range.

    `reach` in rad bounds the margin of extrapolation. `effects`, a torque (N,) in N·m at a pose
    and a speed (N,), are added to gravity.
    """

    predict: Callable[[FloatArray], FloatArray]
    coverage: Coverage
    reach: float = math.inf
    effects: Callable[[FloatArray, FloatArray], FloatArray] | None = None

    def nearest(self, q: FloatArray, last: FloatArray | None = None) -> FloatArray:
        """
        Return pose q (N,) without the whole revolutions of joints outside the trained range.

        Gravity has a period of one revolution, so the torque is the same. Half a revolution from
        the middle of the range another pose becomes the nearest one, and a held torque another
        torque: for `NODE.turn_margin` more, the pose goes on from the `last` one (N,).
        """
        outside = self.coverage.distance(q) > 0.0
        if not outside.any():
            return q
        low, high = self.coverage.q_min, self.coverage.q_max
        middle = 0.5 * (low + high)
        nearest = q - REVOLUTION * np.round((q - middle) / REVOLUTION)
        if last is not None:
            kept = np.maximum(0.5 * (high - low), math.pi) + NODE.turn_margin
            further = q - REVOLUTION * np.round((q - last) / REVOLUTION)
            nearest = np.where(np.abs(further - middle) > kept, nearest, further)
        return np.where(outside, nearest, q)

    def torque(self, q: FloatArray, policy: str, margin: float) -> FloatArray:
        """
        Return gravity (N,) in N·m, by the policy beyond the margin in rad.

        :param q: pose (N,), rad, the `nearest` one.
        """
        if policy == 'trust':
            return self.predict(q)
        inside = np.minimum(np.maximum(q, self.coverage.q_min - margin),
                            self.coverage.q_max + margin)
        outside = float(np.abs(q - inside).max())
        if policy == 'hold':
            return self.predict(inside)
        return self.predict(q) * max(0.0, 1.0 - outside / margin)

    def effect_torque(self, q: FloatArray, qd: FloatArray | None,
                      margin: float) -> FloatArray | None:
        """Return the torque of the effects (N,) in N·m; None without any, far away or unknown."""
        if self.effects is None or qd is None or (self.coverage.distance(q) > margin).any():
            return None
        torque = self.effects(q, qd)
        return torque if all_finite(torque) else None


def std_of(model: GravityModel, q: FloatArray) -> FloatArray:
    """Return the standard deviation of a model's torque (N,) in N·m; empty if there is none."""
    try:
        return model.predict_std(q)[0]
    except (DataError, np.linalg.LinAlgError):
        return np.zeros(0)


class ModelInUse:
    """
    A model with its effects, sample by sample in order of time.

    `source` is the torque to publish, `compensated` the effects in it, as `NAME:JOINT`. `problem`
    is the reason why another effect of the parameter `compensate` is not sent, else empty.
    """

    def __init__(self, model: GravityModel, settings: Parameters) -> None:
        self.model = model
        # Friction that persists at rest has a memory: one of the messages, one of the samples.
        self._effects, self._effects_of_samples = (
            LiveEffects(model, model.applied.effects) for _ in range(2))
        self._fitted = LiveEffects(model, model.fitted.effects)
        self._external: ExternalTorqueObserver | None = None
        self.compensate(settings)

    def compensate(self, settings: Parameters) -> None:
        """Send the effects that the settings list."""
        model, requested = self.model, settings.compensated(self.model.joints)
        sent = LiveEffects(
            model, [effect for effect in model.applied.effects if effect.target in requested],
            Limits(settings.compensate_fraction, COMPENSATION_SPEED, settings.max_speed))
        self.compensated, self.problem = sent.targets, self._effects.problem
        if requested and not sent.targets and not self.problem:
            self.problem = 'the model has none of the effects to compensate'
        self.source = TorqueSource(
            model.predict_one, model.coverage,
            PER_JOINT_REACH if model.formulation == 'per_joint' else math.inf,
            (lambda q, qd: sent.torque(q, qd, model.predict_one(q))) if sent.targets else None)

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
