"""
Slow samples as they arrive: their acceleration, and their residual without nuisance terms.

A fit estimates friction, offset and inertia jointly with gravity (`models.nuisance`), and the
model does not predict them. They are subtracted from the live residual before it is compared with
the noise of the training.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import lru_cache

from gravity_comp_ros.data.acceleration import AccelerationOptions, RecentVelocity
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.motion_direction import smooth_sign
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.nuisance import COULOMB, INERTIA, OFFSET, VISCOUS
from gravity_comp_ros.node.messages import CompleteReading
import numpy as np

# Relative change of friction with temperature and load.
DRIFT = 0.3
# Minimum noise of a joint as a fraction of the largest; a joint without gravity has almost none.
MIN_NOISE_FRACTION = 0.05
_MIN_WIDTH = 1e-6
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
    coulomb = model.nuisance.of(COULOMB)
    size = np.array([abs(coulomb[name].value) if name in coulomb else 0.0
                     for name in model.joints])
    return np.hypot(residual_noise(model), DRIFT * size)


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


class LiveNuisance:
    """
    The nuisance terms of a model, sample by sample.

    Where static friction keeps its direction at rest (`effects.motion_direction`), so does this.
    """

    def __init__(self, model: GravityModel) -> None:
        n, nuisance = model.n_joints, model.nuisance
        self._size = {kind: np.array([
            terms[name].value if name in terms else 0.0 for name in model.joints])
            for kind, terms in ((kind, nuisance.of(kind)) for kind in (COULOMB, VISCOUS, OFFSET))}
        self._width = np.maximum(nuisance.width if nuisance.width.size else np.ones(n),
                                 _MIN_WIDTH)
        self._inertia = np.zeros((n, n))
        for term in nuisance.terms:
            if term.kind == INERTIA and {term.joint, term.source or term.joint} <= set(
                    model.joints):
                joint, source = (model.joints.index(name)
                                 for name in (term.joint, term.source or term.joint))
                self._inertia[joint, source] += term.value
        hold = nuisance.hold if nuisance.hold.size else np.zeros(n)
        self._ramp = nuisance.ramp > 0.0 if nuisance.ramp.size else np.zeros(n, dtype=bool)
        self._holds = hold > 0.0
        self._hold = np.where(self._holds, hold, 1.0)
        self._direction = np.zeros(n)
        self._q: FloatArray | None = None

    def torque(self, q: FloatArray, qd: FloatArray, qdd: FloatArray | None) -> FloatArray:
        """
        Return the nuisance torque (N,) in N·m at pose q (N,), speed qd and acceleration qdd.

        Without an acceleration inertia is neglected.
        """
        moved = np.zeros_like(q) if self._q is None else q - self._q
        self._q = q
        sign = np.sign(moved)
        kept = np.where(sign == 0.0, self._direction, sign + (self._direction - sign) * np.exp(
            -np.abs(moved) / self._hold))
        self._direction = np.where(self._holds, kept,
                                   smooth_sign(qd, self._width, self._ramp))
        torque = (self._size[COULOMB] * self._direction + self._size[VISCOUS] * qd
                  + self._size[OFFSET])
        return np.asarray(torque if qdd is None else torque + self._inertia @ qdd)


@dataclass(eq=False)
class SlowSample:
    """
    A reading that passed the gate, and the torque published before it (`SentTorqueHistory`).

    `qdd` (N,) is its acceleration in rad/s^2, None if the message rate does not resolve it.
    """

    reading: CompleteReading
    sent: FloatArray
    qdd: FloatArray | None = None


class DelayedSamples:
    """
    Slow samples that wait for half a window of later messages.

    An acceleration from earlier messages alone would be that of a moment before the sample.
    """

    def __init__(self, options: AccelerationOptions = AccelerationOptions()) -> None:
        self._delay = 0.5 * options.window
        self._velocity = RecentVelocity(options)
        self._waiting: deque[SlowSample] = deque()

    def restart(self) -> None:
        """Drop all samples: the clock or the payload has changed."""
        self._velocity.restart()
        self._waiting.clear()

    def add_velocity(self, t: float, qd: FloatArray) -> None:
        """Add the velocity (N,) in rad/s of a message at time t in s, slow or not."""
        self._velocity.add(t, qd)

    def hold(self, reading: CompleteReading, sent: FloatArray) -> None:
        """Keep a slow sample."""
        self._waiting.append(SlowSample(reading, sent))

    def due(self, t: float) -> list[SlowSample]:
        """Return the samples that are old enough at time t in s, with their accelerations."""
        ready = []
        while self._waiting and t >= self._waiting[0].reading.t + self._delay:
            sample = self._waiting.popleft()
            sample.qdd = self._velocity.acceleration(sample.reading.t)
            ready.append(sample)
        return ready
