"""Pauses of a motion, sensor errors, and losses before the recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.simulation.motions import Motion, quintic_step, sample
import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Pause:
    """A pause from `start` s: `ramp` s of deceleration, `rest` s, `ramp` s of acceleration."""

    start: float
    rest: float
    ramp: float = 1.0


def with_pauses(motion: Motion, pauses: tuple[Pause, ...]) -> Motion:
    """
    Return the motion along the same curve with pauses.

    The curve parameter s(t) has ds/dt = 1, which falls to 0 in a pause. The sample times are
    unchanged, so that less of the curve is covered. Pauses must not overlap.
    """
    def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        s, rate, change = np.asarray(t, dtype=float), np.ones_like(t), np.zeros_like(t)
        for pause in pauses:
            lost, slowed, slowing = _slowing(t, pause)
            s, rate, change = s - lost, rate - slowed, change - slowing
        q, qd, qdd = motion.path(s)
        rate, change = rate[:, None], change[:, None]
        return q, qd * rate, qdd * rate ** 2 + qd * change

    count = len(motion.t)
    step = float(motion.t[1] - motion.t[0]) if count > 1 else 1.0
    return sample(motion.name, path, count * step, 1 / step, float(motion.t[0]))


def _slowing(t: FloatArray, pause: Pause) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the time lost by a pause (K,) in s, and its first and second derivative."""
    down = _step(t - pause.start, pause.ramp)
    up = _step(t - pause.start - pause.ramp - pause.rest, pause.ramp)
    return down[0] - up[0], down[1] - up[1], down[2] - up[2]


def _step(t: FloatArray, ramp: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return integral, value and slope of a quintic step in `ramp` s."""
    x = t / ramp
    y = np.clip(x, 0.0, 1.0)
    integral = ramp * (y ** 4 * (2.5 - 3 * y + y ** 2) + np.maximum(x - 1.0, 0.0))
    return integral, *quintic_step(t, ramp)[:2]


# Errors of the joint sensors: resolution of the encoders in rad, white noise of the speed in
# rad/s, and the share of the variance of the torque noise with a correlation time in s; the rest
# is white.
_RESOLUTION, _SPEED_NOISE, _CORRELATED, _CORRELATION = 1e-5, 5e-4, 0.3, 0.5


def measured(samples: JointSamples, noise: tuple[float, ...],
             rng: np.random.Generator) -> JointSamples:
    """Return an evenly spaced run with sensor errors; `noise` (N,) of the torque in N·m."""
    shape = samples.q.shape
    q = _RESOLUTION * np.round(samples.q / _RESOLUTION)
    qd = samples.qd + _SPEED_NOISE * rng.standard_normal(shape)
    white, driver = rng.standard_normal(shape), rng.standard_normal(shape)
    slow = ornstein_uhlenbeck(driver, float(samples.t[1] - samples.t[0]), _CORRELATION)
    mixed = np.sqrt(1 - _CORRELATED) * white + np.sqrt(_CORRELATED) * slow
    return replace(samples, q=q, qd=qd, tau=samples.tau + np.asarray(noise) * mixed)


def ornstein_uhlenbeck(driver: ArrayLike, step: float, correlation: float) -> FloatArray:
    """Return an Ornstein-Uhlenbeck process (M, N) of unit variance from white noise (M, N)."""
    from scipy.signal import lfilter  # slow to import
    white = np.asarray(driver, dtype=np.float64)
    keep = float(np.exp(-step / correlation))
    increments = np.sqrt(1 - keep ** 2) * white
    increments[0] = white[0]
    return np.asarray(lfilter([1.0], [1.0, -keep], increments, axis=0))


Degradation = Callable[[JointSamples, np.random.Generator], JointSamples]
"""A loss in the samples of one run."""


def lost_messages(run: JointSamples, rng: np.random.Generator) -> JointSamples:
    """Lose a tenth of the messages at random, and three gaps of a second."""
    keep = rng.random(len(run)) >= 0.1
    for start in rng.uniform(run.t[0], run.t[-1], 3):
        keep &= (run.t < start) | (run.t > start + 1.0)
    return run.select(keep)


def filtered_torque(run: JointSamples, rng: np.random.Generator) -> JointSamples:
    """Smooth the torque by a second-order Butterworth filter with 5 Hz."""
    from scipy import signal  # slow to import

    sections = signal.butter(2, 5.0, fs=1.0 / float(np.median(np.diff(run.t))), output='sos')
    begin = signal.sosfilt_zi(sections)[:, :, None] * run.tau[0]
    return replace(run, tau=signal.sosfilt(sections, run.tau, axis=0, zi=begin)[0])


def stepped_torque(run: JointSamples, rng: np.random.Generator) -> JointSamples:
    """Quantise the torque to steps of 0.1 N·m."""
    return replace(run, tau=np.round(run.tau / 0.1) * 0.1)


def no_velocity(run: JointSamples, rng: np.random.Generator) -> JointSamples:
    """Replace velocities by the derivatives of the positions."""
    qd = differentiate(run.t, run.q)
    known = np.isfinite(qd).all(axis=1)
    return replace(run.select(known), qd=qd[known])
