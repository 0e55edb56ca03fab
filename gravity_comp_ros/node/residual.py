"""
Residual of a model without nuisance terms, its noise, and its size over samples.

A fit estimates friction, offset, inertia and other effects jointly with gravity, and the model
does not predict them (`GravityModel.fitted`). They are subtracted from the live residual before it
is compared with the noise of the training.
"""

from __future__ import annotations

from functools import lru_cache

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.predict import torque_of
from gravity_comp_ros.effects.registry import all_effects
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.node.realtime_effects import LiveEffects
from gravity_comp_ros.node.rows import SlowSample
import numpy as np

# Relative change of friction with temperature and load.
DRIFT = 0.3
# Minimum noise of a joint as a fraction of the largest; a joint without gravity has almost none.
MIN_NOISE_FRACTION = 0.05
# Family of the effects that are friction, number of steps of a motion that measures its size, and
# their speed, rad/s.
FRICTION, _SWEEP, TYPICAL_SPEED = 'friction', 20, 0.1
# Speed below which a joint is at rest for its friction, rad/s.
REST_SPEED = 0.01


@lru_cache(maxsize=8)
def residual_noise(model: GravityModel) -> FloatArray:
    """Return the standard deviation (N,), N·m, of the residual without friction and offset."""
    noise = model.noise_with_nuisance
    return np.maximum(noise, MIN_NOISE_FRACTION * float(noise.max()) + 1e-9)


@lru_cache(maxsize=8)
def expected_residual(model: GravityModel) -> FloatArray:
    """Return the standard deviation (N,), N·m, of that residual plus the drift of friction."""
    return np.hypot(residual_noise(model), DRIFT * friction_size(model))


@lru_cache(maxsize=8)
def friction_size(model: GravityModel) -> FloatArray:
    """Return the RMS friction (N,) in N·m of a model over a sweep through its trained range."""
    coverage, share = model.coverage, np.linspace(0.0, 1.0, 1 + _SWEEP)[:, None]
    q = coverage.q_min + share * (coverage.q_max - coverage.q_min)
    sweep = JointSamples.single_run(model.joints, np.arange(len(q)), q,
                                    np.full_like(q, TYPICAL_SPEED), np.zeros_like(q))
    known = {name for name, effect in all_effects().items() if effect.family == FRICTION}
    friction = [effect for effect in (*model.applied.effects, *model.fitted.effects)
                if effect.name in known]
    # The first sample has no direction yet where friction depends on the path.
    return rms(torque_of(model, friction, sweep)[1:])


def rms(values: FloatArray) -> FloatArray:
    """Return the root mean square of values (M, ...) over the first axis."""
    return np.sqrt(np.mean(np.square(values), axis=0))


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
