"""
Friction and offset of a model, sample by sample: what its residual holds beside noise.

A fit finds friction and offset beside gravity (`models.nuisance`), and the model does not predict
them. The live residual holds them. They are subtracted before the residual is compared with the
noise of the training. Inertia is left out: the samples are slow.
"""

from __future__ import annotations

from functools import lru_cache

from gravity_comp_ros.data.samples import concatenate, FloatArray, JointSamples
from gravity_comp_ros.estimation.nuisance_columns import nuisance_torque
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.nuisance import COULOMB, OFFSET, VISCOUS
import numpy as np

# Friction changes with temperature and load by about this part of itself.
DRIFT = 0.3
# A joint's noise counts as this part of the largest one at least: one without gravity may have
# next to none.
LEAST_PART = 0.05
_LEAST_WIDTH = 1e-6
# rad/s; a joint that is slower is at rest for its friction.
STANDSTILL = 0.01


@lru_cache(maxsize=8)
def residual_noise(model: GravityModel) -> FloatArray:
    """Return the standard deviation (N,) in N·m of the residual beside friction and offset."""
    noise = model.noise_with_nuisance
    return np.maximum(noise, LEAST_PART * float(noise.max()) + 1e-9)


@lru_cache(maxsize=8)
def usual_residual(model: GravityModel) -> FloatArray:
    """Return what a model leaves beside friction where friction drifts as it may (N,), N·m."""
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

    At rest friction has any value between its two directions, which no model predicts. A joint
    that rests most of the time counts at all of them.
    """
    moves = np.abs(qd) > STANDSTILL
    moves |= moves.mean(axis=0) < 0.5
    return np.asarray(np.sqrt((moves * residual ** 2).sum(axis=0) / moves.sum(axis=0)))


def friction_of_both(model: GravityModel, train: JointSamples,
                     held: JointSamples) -> tuple[FloatArray, FloatArray]:
    """
    Return friction and offset of a model at samples that were taken in turns.

    The direction of friction that holds at rest follows from the way that a joint has gone, so
    the samples are taken together, in order of time.
    """
    every = concatenate((train, held))
    order = np.argsort(every.t, kind='stable')
    if (np.diff(every.t[order]) <= 0.0).any():
        return (nuisance_torque(model.nuisance, train),
                nuisance_torque(model.nuisance, held))
    whole_run = JointSamples.single_run(every.names, every.t[order], every.q[order],
                                        every.qd[order], every.tau[order])
    torque = np.empty_like(every.tau)
    torque[order] = nuisance_torque(model.nuisance, whole_run)
    return torque[:len(train)], torque[len(train):]


class LiveFriction:
    """
    The friction and offset that a model was fitted with.

    Where friction holds at rest (`effects.motion_direction`), its direction is kept at rest.
    """

    def __init__(self, model: GravityModel) -> None:
        n, nuisance = model.n_joints, model.nuisance
        self._size = {kind: np.array([
            found[name].value if name in found else 0.0 for name in model.joints])
            for kind, found in ((kind, nuisance.of(kind)) for kind in (COULOMB, VISCOUS, OFFSET))}
        self._width = np.maximum(nuisance.width if nuisance.width.size else np.ones(n),
                                 _LEAST_WIDTH)
        hold = nuisance.hold if nuisance.hold.size else np.zeros(n)
        self._holds = hold > 0.0
        self._hold = np.where(self._holds, hold, 1.0)
        self._direction = np.zeros(n)
        self._q: FloatArray | None = None

    def torque(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Return friction and offset (N,) in N·m at pose q (N,) and speed qd (N,)."""
        moved = np.zeros_like(q) if self._q is None else q - self._q
        self._q = q
        sign = np.sign(moved)
        held = np.where(sign == 0.0, self._direction, sign + (self._direction - sign) * np.exp(
            -np.abs(moved) / self._hold))
        self._direction = np.where(self._holds, held, np.tanh(qd / self._width))
        return np.asarray(self._size[COULOMB] * self._direction + self._size[VISCOUS] * qd
                          + self._size[OFFSET])
