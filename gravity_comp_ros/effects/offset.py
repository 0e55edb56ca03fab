"""Faults of the torque signal: its zero, its scale and their change with time."""

from __future__ import annotations

from gravity_comp_ros.data.runs import session_time
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Coefficient, Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

_SHORTEST = 10.0
# Time constants of a drift that settles: the shortest as a part of the longest session.
_SOONEST, _TIMES = 0.1, 4
# Torque constants are known to a few percent; what friction of load leaves is under one percent.
_LEAST_GAIN = 0.02


class TorqueOffset(Effect):
    name = 'torque_offset'
    title = 'Torque offset'
    family = 'offset'
    equation = 'tau_n = b'
    description = 'A torque signal that is not zero when the torque is.'
    coefficients = (Coefficient('b', 'N·m', 'torque signal at no torque'),)
    confounders = ('asymmetric_friction', 'torque_drift', 'joint_spring', 'tool_force',
                   'coulomb_friction', 'cable_stiffness')
    experiment = 'let joint {joint} stand in ten poses, each reached from below and from above'
    signature = 'time'
    source = ('M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method for '
              'parameter identification of robot dynamics, IEEE Transactions on Control Systems '
              'Technology 21, 2013')
    pointwise = True
    expectation = Expectation.COMMON

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return np.ones((motion.samples.n_samples, 1))


class TorqueGain(Effect):
    name = 'torque_gain'
    title = 'Torque scale'
    family = 'offset'
    equation = 'tau_n = k g_n(q)'
    description = ('A torque signal of the wrong scale: a torque constant or gear ratio that is '
                   'off.')
    coefficients = (Coefficient('k', '', 'relative error of the torque scale'),)
    confounders = ('payload_change', 'load_dependent_friction')
    experiment = ('hang a known mass on the arm and compare the change of torque of joint '
                  '{joint} with the one that its weight and lever arm give')
    signature = 'load'
    source = ('M. Gautier, S. Briot, Global identification of joint drive gains and dynamic '
              'parameters of robots, ASME Journal of Dynamic Systems, Measurement and Control '
              '136, 2014')
    pointwise = True
    largest = 1.0
    why_not_larger = 'the scale is off by more than the torque itself; check --effort-scale'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.gravity[:, [joint]]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if float(motion.gravity[:, joint].std()) < 0.02:
            return 'gravity hardly varies here, so that a scale of it is the same as an offset'
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        gain = float(np.abs(values).max())
        if gain < _LEAST_GAIN:
            return (f'{gain:.2g} is too little: friction that grows with the load looks like a '
                    f'scale that is off by as little')
        return super().implausible(values, setting, motion, joint)


class TorqueDrift(Effect):
    """
    The column is the time of the session, or one that settles, less its mean.

    What warms settles: its rate falls as exp(-t / T). Time constants are tried from a tenth of
    the longest session to all of it; over shorter parts of T the law is a line.
    """

    name = 'torque_drift'
    title = 'Torque drift'
    family = 'offset'
    equation = ('tau_n = r (s - s_0), s_0 the mean of s, t from the start of the session; s = t, '
                'or, where it settles, T (1 - exp(-t / T))')
    description = ('A torque signal whose zero moves with time, as strain gauges do when they '
                   'warm up. Recordings with stamps on one clock are one session.')
    coefficients = (Coefficient('r', 'N·m/s', 'change of the torque signal per second at the '
                                              'start'),)
    confounders = ('friction_drift', 'torque_offset', 'payload_change')
    experiment = ('let joint {joint} stand in one pose for as long as a run takes, before and '
                  'after moving it')
    signature = 'time'
    source = ('K. Hoffmann, An Introduction to Stress Analysis and Transducer Design using '
              'Strain Gauges, HBM, 2012')
    setting_units = {'centre': 's', 'time': 's'}
    not_scanned = ('centre',)
    pointwise = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return (_settling(motion, setting.get('time')) - setting['centre'])[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return a line, and what settles within parts of the longest session."""
        longest = float(session_time(motion.samples).max(initial=0.0))
        line = {'centre': float(session_time(motion.samples).mean())}
        return [line, *(_settles(motion, time) for time in np.geomspace(
            _SOONEST * longest, longest, _TIMES) if time > 0.0)]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        if 'time' not in setting:
            return []
        return [_settles(motion, factor * setting['time']) for factor in (0.75, 1.33)]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        longest = float(session_time(motion.samples).max(initial=0.0))
        if longest < _SHORTEST:
            return f'the longest recording takes {longest:.3g} s, too short to drift'
        return None


def _settling(motion: Motion, time: float | None) -> FloatArray:
    """Return the time of the session (M,) in s, or one whose rate falls as exp(-t / time)."""
    t = session_time(motion.samples)
    return t if time is None else np.asarray(-time * np.expm1(-t / time))


def _settles(motion: Motion, time: float) -> dict[str, float]:
    return {'centre': float(_settling(motion, time).mean()), 'time': float(time)}


EFFECTS = (TorqueOffset(), TorqueGain(), TorqueDrift())
