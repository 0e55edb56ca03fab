"""Errors of the torque signal: zero-point offset, scale and drift."""

from __future__ import annotations

from gravity_comp_ros.data.runs import session_time
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.terms.clock import origin_of, since
from gravity_comp_ros.terms.effect import Coefficient, Effect, Setting, Sizes
from gravity_comp_ros.terms.motion import Motion
import numpy as np

# Minimum duration of a session, in s.
_MIN_DURATION = 10.0
# Minimum time constant relative to the longest session, and number of time constants.
_MIN_TIME, _TIMES = 0.1, 4


class TorqueOffset(Effect):
    name = 'torque_offset'
    coefficients = (Coefficient('b', 'N·m', 'torque signal at zero torque'),)
    uses_gravity = False
    is_static = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return np.ones((motion.samples.n_samples, 1))


class TorqueGain(Effect):
    name = 'torque_gain'
    coefficients = (Coefficient('k', '', 'relative error of the torque scale'),)
    is_static = True
    resembles_gravity = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.gravity[:, [joint]]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if float(motion.gravity[:, joint].std()) < 0.02:
            return ('the gravity torque hardly varies, so that a scale error cannot be '
                    'distinguished from an offset')
        return None

    def prior_std(self, sizes: Sizes) -> FloatArray:
        return np.array([0.1])


class TorqueDrift(Effect):
    """
    The column is the time of the session, or an exponential approach.

    The rate of a drift by warm-up decreases as exp(-t / T). Time constants from a tenth of the
    longest session to its duration are compared; for longer ones the law is close to linear.
    """

    name = 'torque_drift'
    coefficients = (Coefficient('r', 'N·m/s', 'initial rate of change of the torque signal'),)
    uses_gravity = False
    size = 0.05

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        t = since(motion.samples, setting['origin'])
        if 'time' in setting:
            t = -setting['time'] * np.expm1(-t / setting['time'])
        return np.asarray(t)[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return a linear drift, and exponential ones within parts of the longest session."""
        longest = float(session_time(motion.samples).max(initial=0.0))
        origin = origin_of(motion.samples)
        return [{'origin': origin}, *({'origin': origin, 'time': float(time)}
                for time in np.geomspace(_MIN_TIME * longest, longest, _TIMES) if time > 0.0)]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        if 'time' not in setting:
            return []
        return [{**setting, 'time': setting['time'] * 1.33 ** k} for k in (-step, step)]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        longest = float(session_time(motion.samples).max(initial=0.0))
        if longest < _MIN_DURATION:
            return f'the longest session takes {longest:.3g} s, too short for a drift'
        return None


EFFECTS = (TorqueOffset(), TorqueGain(), TorqueDrift())
