"""Measurement noise on torques."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
import numpy as np


@dataclass(frozen=True)
class NoiseOptions:
    """
    Gaussian torque noise.

    `relative` is a standard deviation as a fraction of |tau| (0.01 for the paper's
    N(0, 0.01 tau)); `absolute` is one in N·m, with a correlation time of `correlation` s (0:
    white).

    :raises OptionError: if a value is negative or not finite.
    """

    relative: float = 0.0
    absolute: float = 0.0
    correlation: float = 0.0

    def __post_init__(self) -> None:
        for field in ('relative', 'absolute', 'correlation'):
            value = getattr(self, field)
            if not np.isfinite(value) or value < 0:
                raise OptionError(f'noise: {field} is {value}; it must be 0 or more')


def add_noise(t: FloatArray, tau: FloatArray, options: NoiseOptions,
              rng: np.random.Generator) -> FloatArray:
    """
    Return `tau` (M, N) in N·m with noise; a torque of exactly 0 has no relative noise.

    Correlated noise is a stationary Ornstein-Uhlenbeck process, sampled exactly at `t` (M,) in s.
    """
    noisy = tau + options.relative * np.abs(tau) * rng.standard_normal(tau.shape)
    white = rng.standard_normal(tau.shape)
    if options.correlation > 0:
        white = _correlated(t, white, options.correlation)
    return noisy + options.absolute * white


def _correlated(t: FloatArray, white: FloatArray, time: float) -> FloatArray:
    keep = np.exp(-np.diff(t) / time)
    out = white.copy()
    for k, decay in enumerate(keep, start=1):
        out[k] = decay * out[k - 1] + np.sqrt(1 - decay ** 2) * white[k]
    return out
