"""The model in use: torque for the feed-forward, its effects and share, and residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
import math

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.data.short_vectors import all_finite
from gravity_comp_ros.effects.live import Limits, LiveEffects
from gravity_comp_ros.effects.motion_direction import COMPENSATION_SPEED
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.evaluation.external_torque import (
    ExternalTorque, ExternalTorqueObserver, ExternalTorqueOptions)
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.node.checks import OPTIONS
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

    def nearest(self, q: FloatArray) -> FloatArray:
        """
        Return pose q (N,) with whole revolutions subtracted from joints outside the trained range.

        Gravity has a period of one revolution, so the torque is the same. Within the range `q`
        itself is returned.
        """
        outside = self.coverage.distance(q) > 0.0
        if not outside.any():
            return q
        middle = 0.5 * (self.coverage.q_min + self.coverage.q_max)
        return np.where(outside, q - REVOLUTION * np.round((q - middle) / REVOLUTION), q)

    def torque(self, q: FloatArray, policy: str, margin: float) -> FloatArray:
        """Return gravity (N,) in N·m at pose q (N,), by the policy beyond the margin in rad."""
        nearest = q if policy == 'trust' else self.nearest(q)
        if nearest is q:
            return self.predict(q)
        inside = np.minimum(np.maximum(nearest, self.coverage.q_min - margin),
                            self.coverage.q_max + margin)
        outside = float(np.abs(nearest - inside).max())
        if outside == 0.0:
            return self.predict(nearest)
        if policy == 'hold':
            return self.predict(inside)
        return self.predict(nearest) * max(0.0, 1.0 - outside / margin)

    def effect_torque(self, q: FloatArray, qd: FloatArray | None,
                      margin: float) -> FloatArray | None:
        """Return the torque of the effects (N,) in N·m; None without any, far away or unknown."""
        if self.effects is None or qd is None or (self.coverage.distance(q) > margin).any():
            return None
        torque = self.effects(q, qd)
        return torque if all_finite(torque) else None


@dataclass(eq=False)
class UncertainChange:
    """
    The change of the torque from a model to one of few samples, which is used in part.

    A few seconds of motion determine the change of some joints well and of others badly. With d_n
    the change of the torque of joint n at a pose and s_n its standard deviation,

        share_n = max(0, 1 - (k s_n / d_n)^2),    k = 2 (1 + distance / 0.5 rad),

    the torque is old + share (new - old): a change that is not significant is not sent. `distance`
    is that of the pose from the range of the new samples, where the standard deviation itself is
    less certain. Without a standard deviation no change is significant.

    `model` was learned from few samples in a `range`, `before` is that of the previous payload.
    The `share` in use is none of the change at first.
    """

    model: GravityModel
    before: GravityModel
    range: Coverage
    share: FloatArray | float = 0.0

    def share_at(self, q: FloatArray) -> FloatArray:
        """Return the share (N,) of the change to use at pose q (N,), 0 to 1; it takes 0.2 ms."""
        std = std_of(self.model, q)
        if not std.size:
            return np.zeros(len(q))
        change = self.model.predict_one(q) - self.before.predict_one(q)
        distance = float(self.range.distance(q).max())
        uncertain = OPTIONS.significant * (1.0 + distance / OPTIONS.min_span) * std
        share = 1.0 - (uncertain / np.maximum(np.abs(change), NODE.rounding)) ** 2
        return np.where(np.isfinite(share), np.maximum(0.0, share), 0.0)

    def predict(self, q: FloatArray) -> FloatArray:
        """Return the torque (N,) in N·m: that of the previous model and a share of the change."""
        before = self.before.predict_one(q)
        return before + self.share * (self.model.predict_one(q) - before)


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

    :param change: change from the previous payload where few samples determine it; none of it is
        used until `update_share` is called.
    """

    def __init__(self, model: GravityModel, settings: Parameters,
                 change: UncertainChange | None = None) -> None:
        self.model = model
        self._change = change
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
            self._change.predict if self._change else model.predict_one, model.coverage,
            PER_JOINT_REACH if model.formulation == 'per_joint' else math.inf,
            (lambda q, qd: sent.torque(q, qd, model.predict_one(q))) if sent.targets else None)

    def update_share(self, q: FloatArray) -> bool:
        """Determine the share of an uncertain change at pose q (N,); return whether it differs."""
        change = self._change
        if change is None:
            return False
        before, change.share = change.share, change.share_at(self.source.nearest(q))
        # Another source begins a transition.
        self.source = replace(self.source)
        return bool((change.share != before).any())

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
