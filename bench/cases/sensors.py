"""Sensor errors: encoder resolution, velocity noise, white and correlated torque noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.errors import OptionError
import numpy as np
from numpy.typing import ArrayLike


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
