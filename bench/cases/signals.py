"""Pauses of a motion, sensor errors, and losses before the recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from gravity_comp_ros.data.differentiation import differentiate
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.motions import Motion, quintic_step, sample
import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Pause:
    """A pause from `start` s: `ramp` s of deceleration, `rest` s, `ramp` s of acceleration."""

    start: float
    rest: float
    ramp: float = 1.0

    def __post_init__(self) -> None:
        if not (self.rest >= 0 and self.ramp > 0):
            raise OptionError(f'pause: the rest is {self.rest} s; it must be 0 or more; the ramp '
                              f'is {self.ramp} s; it must be positive')

    @property
    def end(self) -> float:
        return self.start + self.rest + 2 * self.ramp


def with_pauses(motion: Motion, pauses: tuple[Pause, ...]) -> Motion:
    """
    Return the motion along the same curve with pauses.

    The curve parameter s(t) has ds/dt = 1, which falls to 0 in a pause. The sample times are
    unchanged, so that less of the curve is covered.

    :raises OptionError: if two pauses overlap.
    """
    pauses = tuple(sorted(pauses, key=lambda pause: pause.start))
    if any(a.end > b.start for a, b in zip(pauses, pauses[1:])):
        raise OptionError('pauses overlap; separate them')

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


@dataclass(frozen=True)
class SensorOptions:
    """
    Errors of the joint sensors.

    `resolution` of the encoders in rad; `speed_noise` in rad/s, white; `torque_noise` the
    standard deviation in N·m (one value per joint, or one for all). The fraction `correlated` of
    its variance has the correlation time `correlation` in s; the rest is white.

    :raises OptionError: if a value is negative, or the fraction is not between 0 and 1.
    """

    torque_noise: tuple[float, ...]
    correlated: float = 0.3
    correlation: float = 0.5
    resolution: float = 1e-5
    speed_noise: float = 5e-4

    def __post_init__(self) -> None:
        for field in ('torque_noise', 'resolution', 'speed_noise', 'correlation'):
            if not np.all(np.asarray(getattr(self, field)) >= 0):
                raise OptionError(f'sensors: {field} must be 0 or more')
        if not 0 <= self.correlated <= 1:
            raise OptionError(f'sensors: the correlated part is {self.correlated}; it must be '
                              f'between 0 and 1')


def measured(samples: JointSamples, options: SensorOptions,
             rng: np.random.Generator) -> JointSamples:
    """Return one run of evenly spaced samples with sensor errors."""
    shape = samples.q.shape
    q = samples.q
    if options.resolution:
        q = options.resolution * np.round(q / options.resolution)
    qd = samples.qd + options.speed_noise * rng.standard_normal(shape)
    step = float(samples.t[1] - samples.t[0]) if len(samples) > 1 else 0.0
    tau = samples.tau + torque_noise(shape, step, options, rng)
    return replace(samples, q=q, qd=qd, tau=tau)


def torque_noise(shape: tuple[int, ...], step: float, options: SensorOptions,
                 rng: np.random.Generator) -> FloatArray:
    """Return noise (M, N) in N·m: white, and a stationary Ornstein-Uhlenbeck process."""
    white, driver = rng.standard_normal(shape), rng.standard_normal(shape)
    slow = ornstein_uhlenbeck(driver, step, options.correlation)
    share = options.correlated
    level = np.asarray(options.torque_noise)
    return np.asarray(level * (np.sqrt(1 - share) * white + np.sqrt(share) * slow))


def ornstein_uhlenbeck(driver: ArrayLike, step: float, correlation: float) -> FloatArray:
    """Return an Ornstein-Uhlenbeck process (M, N) of unit variance from white noise (M, N)."""
    from scipy.signal import lfilter  # slow to import
    white = np.asarray(driver, dtype=np.float64)
    keep = float(np.exp(-step / correlation)) if correlation > 0 else 0.0
    increments = np.sqrt(1 - keep ** 2) * white
    increments[0] = white[0]
    return np.asarray(lfilter([1.0], [1.0, -keep], increments, axis=0))


class Degradation(Protocol):
    """A loss in the samples of one run."""

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        """Return the run after the loss."""


@dataclass(frozen=True)
class LostMessages:
    """Lost messages: the share `single` at random, and `bursts` gaps of a second."""

    single: float = 0.1
    bursts: int = 3

    def __post_init__(self) -> None:
        if not 0.0 <= self.single < 1.0 or self.bursts < 0:
            raise OptionError('lost messages: single lies in [0, 1), bursts is at least 0')

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        keep = rng.random(len(run)) >= self.single
        for start in rng.uniform(run.t[0], run.t[-1], self.bursts):
            keep &= (run.t < start) | (run.t > start + 1.0)
        return run.select(keep)


@dataclass(frozen=True)
class FilteredTorque:
    """Torque smoothed by a second-order Butterworth filter with `cutoff` Hz."""

    cutoff: float = 5.0

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        from scipy import signal  # slow to import

        rate = 1.0 / float(np.median(np.diff(run.t)))
        sections = signal.butter(2, self.cutoff, fs=rate, output='sos')
        begin = signal.sosfilt_zi(sections)[:, :, None] * run.tau[0]
        return replace(run, tau=signal.sosfilt(sections, run.tau, axis=0, zi=begin)[0])


@dataclass(frozen=True)
class SteppedTorque:
    """Torque quantised to `step` N·m."""

    step: float = 0.1

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        return replace(run, tau=np.round(run.tau / self.step) * self.step)


@dataclass(frozen=True)
class NoVelocity:
    """Missing velocities, differentiated from the positions."""

    def apply(self, run: JointSamples, rng: np.random.Generator) -> JointSamples:
        qd = differentiate(run.t, run.q)
        known = np.isfinite(qd).all(axis=1)
        return replace(run.select(known), qd=qd[known])
