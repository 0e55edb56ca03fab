"""
Residual of a model without nuisance terms, and its size over samples.

A fit estimates friction, offset, inertia and other effects jointly with gravity, and the model
does not predict them (`GravityModel.fitted`). They are subtracted from the live residual before it
is compared with the noise of the training.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.live import LiveEffects
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.rows import SlowSample
import numpy as np

# Speed below which a joint is at rest for its friction, rad/s.
REST_SPEED = 0.01


def moving_rms(residual: FloatArray, qd: FloatArray) -> FloatArray:
    """
    Return the RMS (N,) in N·m of a residual (M, N) over the samples at which the joint moves.

    At rest friction has any value between its two directions, which no model predicts. All
    samples count for a joint that is at rest most of the time.
    """
    moves = np.abs(qd) > REST_SPEED
    moves |= moves.mean(axis=0) < 0.5
    return np.asarray(np.sqrt((moves * residual ** 2).sum(axis=0) / moves.sum(axis=0)))


class LiveResidual:
    """
    The residual of a model sample by sample in order of time, with and without nuisance terms.

    Friction that persists at rest does so here, too (`effects.presliding`).
    """

    def __init__(self, model: GravityModel) -> None:
        self._predicted = LiveEffects(model, model.applied.effects)
        self._fitted = LiveEffects(model, model.fitted.effects)

    def of(self, sample: SlowSample, gravity: FloatArray,
           qdd: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """
        Return measured minus predicted torque (N,) in N·m, and the same minus nuisance torque.

        :param gravity: the model's torque at the pose (N,), N·m.
        :param qdd: acceleration (N,) in rad/s^2; without one inertia is neglected.
        """
        reading = sample.reading
        error = reading.tau - gravity - self._predicted.torque(
            reading.q, reading.qd, gravity, qdd)
        return error, error - self._fitted.torque(reading.q, reading.qd, gravity, qdd)
