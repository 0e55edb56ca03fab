"""Motions with pauses."""

from __future__ import annotations

from dataclasses import dataclass

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation.motions import Motion, quintic_step, sample
import numpy as np


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
