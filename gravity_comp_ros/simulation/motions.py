"""Joint motions with their exact velocities and accelerations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
import numpy as np
from numpy.typing import ArrayLike

Path = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Function of times (M,) in s that returns q, qd, qdd, each (M, N) in rad, rad/s, rad/s²."""


@dataclass(frozen=True, eq=False)
class Motion:
    """
    A motion sampled at M instants.

    `t` (M,) in s; `q`, `qd`, `qdd` (M, N) in rad, rad/s and rad/s². `path` returns them at any
    other time, so that disturbances with a state can be integrated in finer steps.
    """

    name: str
    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    path: Path

    @property
    def n_joints(self) -> int:
        return int(self.q.shape[1])


@dataclass(frozen=True)
class MultisineOptions:
    """
    Options of a multisine motion.

    `max_speed` in rad/s bounds every joint, in addition to its own speed limit. The motion
    repeats after `period` s; each joint is a sum of `n_sines` harmonics of 1/period up to
    `band` Hz. It starts at rest and reaches full amplitude after `ramp` s.
    """

    max_speed: float = 0.1
    period: float = 100.0
    band: float = 0.1
    n_sines: int = 5
    ramp: float = 5.0


def eq15(duration: float = 20.0, rate: float = 10.0, start: float = 0.0) -> Motion:
    """
    Return the test motion of Yu 2022, Eq. (15): seven joints, up to 3.1 rad/s.

    :param duration: s. :param rate: Hz. :param start: time of the first sample in s.
    """
    amplitude = np.array([1.4, 1.4, 1.8, 1.3, 3.0, 2.0, 3.0])
    omega = np.pi * np.array([0.25, 0.2, 0.167, 0.25, 0.33, 0.167, 0.2])
    phase = np.array([0.0, 0.0, 0.0, -0.167 * np.pi, 0.0, 0.0, 0.0])
    return sample('eq15', sines(amplitude, omega, phase, np.zeros(7)), duration, rate, start)


def eq17(duration: float = 100.0, rate: float = 5.0, start: float = 0.0) -> Motion:
    """
    Return the slow training motion of Yu 2022, Eq. (17): seven joints, up to 0.1125 rad/s.

    :param duration: s. :param rate: Hz. :param start: time of the first sample in s.
    """
    amplitude = np.array([0.65, 0.25, 0.5, 0.9, 0.25, 0.4, 0.25])
    omega = np.array([0.1, 0.2, 0.2, 0.125, 0.2, 0.25, 0.2])
    cosine = np.array([0, 1, 0, 0, 0, 1, 0]) * np.pi / 2
    phase = np.array([1.5, 0.2, 0.3, 0.2, 0.0, 0.4, 0.4]) + cosine
    offset = np.array([0.0, 0.5, 0.0, 0.25, 0.0, 0.25, 0.0]) - amplitude * np.sin(phase)
    offset[0] = 0.0  # Eq. (17) subtracts the value at t = 0 for every joint except the first.
    return sample('eq17', sines(amplitude, omega, phase, offset), duration, rate, start)


def random_poses(lower: ArrayLike, upper: ArrayLike, count: int, seed: int = 0,
                 period: float = 2.0, start: float = 0.0) -> Motion:
    """
    Return `count` poses at rest, uniform between the limits, one every `period` s.

    :param lower: lower limits (N,) in rad. :param upper: upper limits (N,) in rad.
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    poses = np.random.default_rng(seed).uniform(low, high, size=(count, low.size))

    def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        number = np.floor((t - start) / period + 1e-9).astype(int)
        q = poses[np.clip(number, 0, count - 1)]
        return q, np.zeros_like(q), np.zeros_like(q)

    t: FloatArray = start + period * np.arange(count, dtype=np.float64)
    return Motion('random', t, *path(t), path)


def multisine(lower: ArrayLike, upper: ArrayLike, speed_limit: ArrayLike, seed: int = 0,
              options: MultisineOptions = MultisineOptions(), duration: float = 100.0,
              rate: float = 5.0, start: float = 0.0) -> Motion:
    """
    Return a seeded sum of sines within position and speed limits for all time.

    Amplitudes are inverse to the frequency, so that every sine adds the same speed. Each joint
    is scaled to its speed bound, or to 95 % of its range if that is smaller, and has a random
    admissible centre. The motion of a seed is the same for every rate, duration and start.

    :param lower: lower limits (N,) in rad. :param upper: upper limits (N,) in rad.
    :param speed_limit: the joints' own limits (N,) in rad/s.
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    rng = np.random.default_rng(seed)
    highest = int(np.floor(options.band * options.period + 1e-9))
    shapes = []
    for _ in range(low.size):
        order = np.sort(rng.permutation(np.arange(1, highest + 1))[:options.n_sines])
        shapes.append((order, rng.uniform(0, 2 * np.pi, size=order.size)))
    omega, phase = (np.stack(values, axis=1) for values in zip(*shapes))
    omega = 2 * np.pi * omega / options.period
    shape = _ramped(sines(1 / omega, omega, phase, np.zeros(low.size)), options.ramp)
    # The phase of the fastest sine advances by at most 0.063 rad per step, so that the grid
    # underestimates a peak by 0.05 %; the margins below are four times that.
    step = min(0.01 / options.band, options.ramp / 200)
    fine = np.arange(0.0, options.ramp + options.period + step, step)
    unit_q, unit_qd, _ = shape(fine)
    bound = np.minimum(options.max_speed, np.asarray(speed_limit, dtype=float))
    by_speed = 0.998 * bound / np.abs(unit_qd).max(axis=0)
    by_range = 0.95 * (high - low) / np.ptp(unit_q, axis=0)
    scale = np.minimum(by_speed, by_range)
    margin = 0.002 * scale * np.ptp(unit_q, axis=0)
    lowest_centre = low - scale * unit_q.min(axis=0) + margin
    highest_centre = high - scale * unit_q.max(axis=0) - margin
    centre = rng.uniform(lowest_centre, highest_centre)

    def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        q, qd, qdd = shape(t)
        return centre + scale * q, scale * qd, scale * qdd

    return sample('multisine', path, duration, rate, start)


def sample(name: str, path: Path, duration: float, rate: float, start: float = 0.0) -> Motion:
    """
    Return a path at `rate` Hz for `duration` s: round(duration * rate) samples.

    :raises OptionError: if there is no sample.
    """
    count = int(round(duration * rate))
    if count < 1:
        raise OptionError(f'{duration} s at {rate} Hz gives no sample')
    t: FloatArray = start + np.arange(count, dtype=np.float64) / rate
    return Motion(name, t, *path(t), path)


def sines(amplitude: FloatArray, omega: FloatArray, phase: FloatArray,
          offset: FloatArray) -> Path:
    """Return a sum of K sines, each parameter (K, N) or (N,) in rad and s, about an offset."""
    shapes = list(zip(*map(np.atleast_2d, (amplitude, omega, phase))))

    def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        q, qd, qdd = (np.zeros((len(t), len(offset))) for _ in range(3))
        for a, w, p in shapes:
            angle = np.multiply.outer(t, w) + p
            q += a * np.sin(angle)
            qd += a * w * np.cos(angle)
            qdd -= a * w ** 2 * np.sin(angle)
        return q + offset, qd, qdd
    return path


def quintic_step(t: FloatArray, duration: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a smooth step from 0 at t = 0 to 1 at the duration, and two derivatives."""
    x: FloatArray = np.clip(np.asarray(t, dtype=np.float64) / duration, 0.0, 1.0)
    return (x ** 3 * (10 - 15 * x + 6 * x ** 2), 30 * x ** 2 * (1 - x) ** 2 / duration,
            60 * x * (1 - x) * (1 - 2 * x) / duration ** 2)


def _ramped(path: Path, ramp: float) -> Path:
    """Return a path times a quintic step of `ramp` s."""
    def ramped(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        w, wd, wdd = (x[:, None] for x in quintic_step(t, ramp))
        s, sd, sdd = path(t)
        return w * s, w * sd + wd * s, w * sdd + 2 * wd * sd + wdd * s
    return ramped
