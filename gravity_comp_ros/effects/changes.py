"""
Effects that begin during a recording: change points, encoder offsets, base tilt and payload.

The gravity of a model is that of the end of a recording, and absorbs an error that is there
throughout. An effect describes the difference before the change. A change point is a clock time,
so later recordings are predicted without the effect. Without a clock it is a time within a run of
a recording, and other recordings are predicted without the effect. An error against an earlier
model or a robot description is found by comparing that with a fit.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

from gravity_comp_ros.data.runs import recorded_time, run_slices, run_time
from gravity_comp_ros.data.samples import BoolArray, FloatArray, JointSamples
from gravity_comp_ros.effects.clock import clock_time, has_clock, is_stamped
from gravity_comp_ros.effects.effect import Coefficient, Coefficients, Effect, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.kinematic.chain import Chain, ForwardKinematics
import numpy as np

# Numbers of parts of a single run and of one of several runs; more runs than this are not divided.
_PARTS_OF_ONE_RUN = 10
_PARTS_OF_SEVERAL = 4
_MAX_RUNS_DIVIDED = 8
# Minimum duration of motion before and after a change, in s: with less, the effect is a part of
# gravity. Accuracy in s of a duration computed from a share of the samples.
_MIN_DURATION, _ROUNDING = 10.0, 0.1
# Step of refined change points, relative to a part of a run.
_FINER = 0.5
# Minimum gravity torque per coefficient, in N·m/rad of an angle.
_MIN_GRADIENT = 0.05
UNITS = {'run': 'run number', 'time': 's', 'clock': 's', 'recording': ''}


def change_factor(motion: Motion, setting: Setting) -> FloatArray:
    """
    Return the factor of a change at each sample, (M,): -1 before it, 0 from it on.

    Without a clock the change is in the run with the fingerprint `recording`, if it is known.
    """
    samples = motion.samples
    if setting['clock'] == 0.0:
        return np.where(_before(samples, setting), -1.0, 0.0)
    if not is_stamped(samples):
        return np.zeros(samples.n_samples)
    return np.where(clock_time(samples) < setting['clock'], -1.0, 0.0)


def _before(samples: JointSamples, setting: Setting) -> BoolArray:
    """Return a mask (M,) of the samples before `time` s in a run, none in other recordings."""
    run, recording = setting['run'] - 1, setting.get('recording', 0.0)
    if recording:
        if recording not in samples.fingerprints:
            return np.zeros(samples.n_samples, dtype=bool)
        run = samples.fingerprints.index(int(recording))
    return np.asarray((samples.runs < run)
                      | ((samples.runs == run) & (run_time(samples) < setting['time'])))


def change_points(motion: Motion) -> list[dict[str, float]]:
    """Return the starts of all runs except the first, and points within each run."""
    samples, time = motion.samples, run_time(motion.samples)
    slices = run_slices(samples)
    parts = _parts(len(slices))
    points = [_point(samples, int(samples.runs[run.start]), float(k * time[run][-1] / parts))
              for run in slices for k in range(parts)]
    return _with_motion(motion, points)


def finer_points(motion: Motion, setting: Setting, step: float) -> list[dict[str, float]]:
    """Return change points between a given one and its neighbours."""
    run = int(setting['run']) - 1
    here = motion.samples.runs == run
    length = float(run_time(motion.samples)[here].max(initial=0.0))
    width = step * _FINER * length / _parts(len(run_slices(motion.samples)))
    moved = [setting['time'] + k * width for k in (-1, 1)]
    return _with_motion(motion, [_point(motion.samples, run, time) for time in moved
                                 if 0.0 <= time < length])


def _with_motion(motion: Motion, points: list[dict[str, float]]) -> list[dict[str, float]]:
    """Return the change points with enough motion before and after them."""
    seconds = recorded_time(motion.samples)
    before = [seconds * float((change_factor(motion, point) < 0.0).mean()) for point in points]
    return [point for point, time in zip(points, before)
            if min(time, seconds - time) >= _MIN_DURATION - _ROUNDING]


def _point(samples: JointSamples, run: int, time: float) -> dict[str, float]:
    """Return the setting of a change at `time` s in a run; `clock` is 0 without a clock."""
    stamp, recording = 0.0, float(samples.fingerprints[run]) if samples.fingerprints else 0.0
    if has_clock(samples):
        first = samples.t[np.searchsorted(samples.runs, run)]
        stamp = float(samples.starts[run] + first + time)
    return {'run': run + 1.0, 'time': time, 'clock': stamp, 'recording': recording}


def _parts(n_runs: int) -> int:
    if n_runs > _MAX_RUNS_DIVIDED:
        return 1
    return _PARTS_OF_ONE_RUN if n_runs == 1 else _PARTS_OF_SEVERAL


class ChangeEffect(Effect):
    """
    An effect that begins at a change point, which is its setting.

    `changing` names the cause of the change, in text.
    """

    setting_units = UNITS
    scope = 'arm'
    is_static = True
    resembles_gravity = True
    changing: str

    @abstractmethod
    def change(self, motion: Motion, joint: int) -> FloatArray:
        """Return the torque of all joints after the change, (M, N, K), per coefficient."""

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return self.change(motion, joint) * change_factor(motion, setting)[:, None, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return change_points(motion)

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        return finer_points(motion, setting, step)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if not self.per_joint and motion.chain is None:
            return f'{self.changing} requires a serial arm as the model of gravity'
        if not change_points(motion):
            return (f'the recordings take {recorded_time(motion.samples):.1f} s: a change '
                    f'requires {_MIN_DURATION:.0f} s of motion before and after it')
        slope = float(np.sqrt(np.mean(self.change(motion, joint) ** 2, axis=0)).max())
        if slope < _MIN_GRADIENT:
            unit = f'N·m/{self.coefficients[0].unit}'
            return f'no gravity torque depends on {self.changing} ({slope:.2g} {unit})'
        return None


class EncoderOffset(ChangeEffect):
    """Offset of a joint's zero angle that begins at a change point."""

    name = 'encoder_offset'
    title = 'Encoder offset'
    family = 'geometry'
    equation = 'tau = -delta dg(q)/dq_n before a time'
    description = ('Zero angle of a joint that changes, for example by a slipping coupling. It '
                   'changes the torque of all joints.')
    coefficients = (Coefficient('delta', 'rad', 'change of the true angle minus the reported '
                                                'angle'),)
    confounders = ('base_tilt', 'payload_change', 'joint_flexibility')
    experiment = 'move joint {joint} to its calibration mark and read its angle'
    signature = 'position'
    source = 'Yu 2022, Eq. (2), expanded to first order in one angle'
    changing = 'the angle of this joint'
    largest = 0.3
    why_not_larger = 'a linear model of the offset is inaccurate at this size; fit a new model'
    std = 0.05

    def change(self, motion: Motion, joint: int) -> FloatArray:
        return motion.gradient[:, :, [joint]]


class BaseTilt(ChangeEffect):
    """The columns are the torque of all joints per tilt of the base, negative before it."""

    name = 'base_tilt'
    title = 'Base tilt'
    family = 'geometry'
    equation = 'tau = -alpha dg/dalpha - beta dg/dbeta before a time'
    description = ('Base that tilts during the recording, as that of a mobile robot. A tilt that '
                   'is there throughout is a part of the gravity model.')
    coefficients = (Coefficient('alpha', 'rad', 'change of the tilt about the first axis of the '
                                                'frame of the first joint'),
                    Coefficient('beta', 'rad', 'the same about the second axis'))
    confounders = ('encoder_offset', 'joint_spring', 'payload_change')
    experiment = ('check the base with a spirit level; move the first joint over its whole range '
                  'with the arm extended horizontally')
    signature = 'position of joint 1'
    source = ('R. Featherstone, Rigid Body Dynamics Algorithms, Springer, 2008 (gravity as an '
              'acceleration of the base)')
    per_joint = False
    changing = 'a tilt of the base'
    largest = 0.35
    why_not_larger = 'such a tilt would be visible'
    std = 0.1

    def change(self, motion: Motion, joint: int) -> FloatArray:
        return _of_chain(motion, 'tilt', lambda kinematics, chain: kinematics.axis_columns(
            chain.moments)[:2])


class PayloadChange(ChangeEffect):
    """
    The columns are the torque of each moment of the chain, negative before the change.

    A mass at the tool adds to every first moment h_i of the chain. Without the lengths of the
    links the changes of the moments are free, with a prior of the size of the moments.
    """

    name = 'payload_change'
    title = 'Payload change during the recording'
    family = 'payload'
    equation = ('tau = -sum_i (m_i d/dh_ix + n_i d/dh_iy) tau_g before the change, h_i the first '
                'moment about joint i')
    description = 'Tool or load that is attached or removed during the recording.'
    coefficients = (Coefficient('m_i', 'N·m', 'change of the first moment about joint number i, '
                                              'in its first direction'),
                    Coefficient('n_i', 'N·m', 'the same in its second direction'))
    confounders = ('torque_gain', 'torque_drift', 'encoder_offset', 'base_tilt')
    experiment = ('record one run with the load and one without it, and estimate the change with '
                  '`gravity_comp update`')
    signature = 'time'
    source = 'Yu 2022 (updates after a change of payload); derived in effects/changes.py'
    per_joint = False
    changing = 'a payload'
    shares = (0.5,)

    def change(self, motion: Motion, joint: int) -> FloatArray:
        return _of_chain(motion, 'moments', lambda kinematics, chain: kinematics.moment_columns())

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        return tuple(Coefficient(f'{symbol}_{n + 1}', 'N·m',
                                 f'change of the first moment about joint number {n + 1}')
                     for n in range(motion.samples.n_joints) for symbol in ('m', 'n'))


def _of_chain(motion: Motion, key: str,
              columns: Callable[[ForwardKinematics, Chain], FloatArray]) -> FloatArray:
    """Return columns (K, N, M) of the chain of a motion as (M, N, K), computed once."""
    assert motion.chain is not None
    if key not in motion.of_gravity:
        kinematics = ForwardKinematics(motion.chain.axes, motion.samples.q)
        motion.of_gravity[key] = columns(kinematics, motion.chain).transpose(2, 1, 0)
    return motion.of_gravity[key]


EFFECTS = (EncoderOffset(), BaseTilt(), PayloadChange())
