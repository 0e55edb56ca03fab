"""The model in use: torque for the feed-forward, its effects, and residuals."""

from __future__ import annotations

from functools import partial
import math

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.predict import LiveEffects, static_effects, static_std
from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.evaluation.external_torque import (
    ExternalTorque, ExternalTorqueObserver, ExternalTorqueOptions)
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.messages import CompleteReading, Reading
import numpy as np

# Largest extrapolation of a per_joint model, rad. Such torques share no energy; a radian outside
# the trained range their errors are hundreds of N·m.
PER_JOINT_REACH = ExternalTorqueOptions().margin


def std_of(model: GravityModel, q: FloatArray) -> FloatArray:
    """Return the standard deviation of a model's torque (N,) in N·m; empty if there is none."""
    try:
        return static_std(model, q[None])[0]
    except (DataError, ModelMismatchError, np.linalg.LinAlgError):
        return np.zeros(0)


class ModelInUse:
    """
    A model with its effects, sample by sample in order of time.

    `static` is the torque to publish: gravity and the static effects `published` (`NAME:JOINT`).
    `problem` gives the reason why another effect of the model is left out, else it is empty.
    """

    def __init__(self, model: GravityModel) -> None:
        self.model = model
        # Friction that persists at rest has a memory: one of the messages, one of the samples.
        self._effects, self._effects_of_samples = (
            LiveEffects(model, model.applied.effects) for _ in range(2))
        self._fitted = LiveEffects(model, model.fitted.effects)
        self._external: ExternalTorqueObserver | None = None
        static = LiveEffects(model, static_effects(model.applied.effects))
        self.published, self.problem = static.targets, self._effects.problem
        if static.left_out and not self.problem:
            self.problem = f'without {", ".join(static.left_out)}, which depends on time'

        # The torque to publish at a pose, and how far it is extrapolated, rad.
        self.static = partial(self._static, static) if static.targets else model.predict_one
        self.reach = PER_JOINT_REACH if model.formulation == 'per_joint' else math.inf

    def _static(self, effects: LiveEffects, q: FloatArray) -> FloatArray:
        gravity, range_ = self.model.predict_one(q), self.model.coverage
        # A spring or a stop, unlike gravity, grows without limit outside the trained range.
        inside = np.minimum(np.maximum(q, range_.q_min), range_.q_max)
        return gravity + effects.torque(inside, np.zeros_like(q), gravity)

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
        if reading.new_run:
            self._external.restart()
        return self._external.add(reading.t, reading.q, reading.qd, reading.tau)
