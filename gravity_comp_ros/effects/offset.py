"""Errors of the torque signal: zero-point offset, scale, drift and delay."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.clock import (
    has_clock, longest_session, refined_time, session_of, since, time_constants)
from gravity_comp_ros.effects.effect import (
    Coefficient, Coefficients, Effect, Needs, Setting)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np

# Difference in s below which stamps are of the same start.
_SAME_START = 1e-3
# Minimum duration of a session, in s.
_MIN_DURATION = 10.0
# Minimum RMS rate of the gravity torque for a delay, in N·m/s.
_MIN_RATE = 0.02


class RecordingEffect(Effect):
    """
    An effect with one value, or with one for each recording.

    The settings are the starts of the recordings, or their fingerprints without a common clock;
    `deviating` names the value in the text of its deviations d_k.
    """

    setting_units = {'start_k': 's', 'recording_k': ''}
    deviating: str

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return one value, and one for each recording."""
        name, recordings = _names(motion.samples, has_clock(motion.samples))
        if len(set(recordings)) < max(2, motion.samples.n_runs):
            return [{}]
        return [{}, {f'{name}_{k + 1}': float(x) for k, x in enumerate(recordings)}]

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        unit = self.coefficients[0].unit
        return (*self.coefficients, *(
            Coefficient(f'd_{k}', unit, f'deviation of the {self.deviating} in recording {k}')
            for k in range(1, len(setting))))

    @staticmethod
    def factors(motion: Motion, setting: Setting) -> FloatArray:
        """
        Return the factors (M, K) of a mean, and of the deviations of all but the last.

        Other recordings, and samples of which the recording is unknown, have the mean.
        """
        samples, recordings = motion.samples, np.array(list(setting.values()))
        columns = np.zeros((samples.n_samples, max(1, len(recordings))))
        columns[:, 0] = 1.0
        own = _names(samples, 'start_1' in setting)[1]
        if len(recordings) and own:
            here = np.abs(np.array(own)[samples.runs, None] - recordings) < _SAME_START
            columns[:, 1:] = here[:, :-1].astype(np.float64) - here[:, -1:]
        return columns


def _names(samples: JointSamples, clock: bool) -> tuple[str, tuple[float, ...]]:
    """Return the kind of names of recordings, and the name of each run: start or fingerprint."""
    return ('start', samples.starts) if clock else ('recording', samples.fingerprints)


class TorqueOffset(RecordingEffect):
    """
    The column is 1, and there are others if the offset differs between recordings.

    A sensor that is zeroed at each start has another offset in each recording. Setting `start_k`
    is the start of recording k on the clock in s, or `recording_k` its fingerprint if there is no
    common clock. Coefficient d_k is the deviation of its offset
    from the mean b of the R recordings, and the last deviation is minus the sum of the others. In
    another recording, b is predicted. Both settings are compared.
    """

    name = 'torque_offset'
    title = 'Torque offset'
    family = 'offset'
    equation = 'tau_n = b, or b + d_k in recording k'
    description = ('Torque signal with a zero-point error, which may differ between recordings '
                   'if the sensor is zeroed at each start.')
    coefficients = (Coefficient('b', 'N·m', 'torque signal at zero torque'),)
    confounders = ('asymmetric_friction', 'torque_drift', 'joint_spring', 'tool_force',
                   'coulomb_friction', 'cable_stiffness')
    experiment = 'hold joint {joint} at ten angles, each approached from below and from above'
    signature = 'time'
    deviating = 'offset'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('M. Gautier, A. Janot, P.-O. Vandanjon, A new closed-loop output error method for '
              'parameter identification of robot dynamics, IEEE Transactions on Control Systems '
              'Technology 21, 2013')
    is_static = True
    # As the constant of a spring.
    size = 0.3

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return self.factors(motion, setting)


def offset_std(model: GravityModel) -> FloatArray:
    """Return the standard deviation (N,) of offsets between recordings in a model, N·m."""
    std = np.zeros(model.n_joints)
    for effect in (*model.applied.effects, *model.fitted.effects):
        own = np.array([c.value for name, c in effect.coefficients.items() if name != 'b'])
        if effect.name == TorqueOffset.name and effect.joint is not None and own.size:
            # The deviations sum to 0.
            std[model.joints.index(effect.joint)] = np.append(own, -own.sum()).std(ddof=1)
    return std


class TorqueGain(RecordingEffect):
    """
    The column is gravity, and there are others if the gain differs between recordings.

    The settings and the deviations d_k are those of `TorqueOffset`: a sensor may be calibrated, or
    a drive changed, between recordings.
    """

    name = 'torque_gain'
    title = 'Torque scale error'
    family = 'offset'
    equation = 'tau_n = k g_n(q), or (k + d_k) g_n(q) in recording k'
    description = ('Torque signal with an incorrect torque constant or gear ratio, which may '
                   'differ between recordings if the sensor is calibrated at each start.')
    coefficients = (Coefficient('k', '', 'relative error of the torque scale'),)
    confounders = ('payload_change', 'load_dependent_friction')
    experiment = ('attach a known mass to the arm and compare the change of the torque of joint '
                  '{joint} with weight times lever arm')
    signature = 'load'
    deviating = 'error'
    needs = Needs.SPEED
    source = ('M. Gautier, S. Briot, Global identification of joint drive gains and dynamic '
              'parameters of robots, ASME Journal of Dynamic Systems, Measurement and Control '
              '136, 2014')
    is_static = True
    resembles_gravity = True
    largest = 1.0
    why_not_larger = 'the scale error exceeds 100 %; check --effort-scale'
    std = 0.1

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.gravity[:, [joint]] * self.factors(motion, setting)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return excitation.insufficient_load(motion.gravity[:, joint])


class TorqueDrift(Effect):
    """
    The response of a sensor that warms up with its mount: two thermal masses in series.

    Its rate may rise before it fades, since the sensor lags behind. Of two masses with time
    constants near T the response is in the span of the columns; time constants from two minutes,
    or a tenth of the longest session, to three times its duration are compared. With long ones
    the law is close to linear.
    """

    name = 'torque_drift'
    title = 'Torque drift'
    family = 'offset'
    equation = ('tau_n = r t / T exp(-t / T) + b (1 - (1 + t / T) exp(-t / T)), t from the start '
                'of the session')
    description = 'Torque signal whose zero point drifts, as with strain gauges that warm up.'
    coefficients = (Coefficient('r', 'N·m', 'initial rate of change of the signal, times T'),
                    Coefficient('b', 'N·m', 'change of the torque signal after a long time'))
    confounders = ('friction_drift', 'torque_offset', 'payload_change')
    experiment = ('hold joint {joint} in one pose for the duration of a run, before and after '
                  'moving it')
    signature = 'time'
    uses_gravity = False
    source = ('K. Hoffmann, An Introduction to Stress Analysis and Transducer Design using '
              'Strain Gauges, HBM, 2012')
    setting_units = {'origin': 's', 'end': 's', 'time': 's'}
    # Relative to the final change: an early part of a drift is small.
    shares = (0.1,)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        age = since(motion.samples, setting) / setting['time']
        fading = np.exp(-age)
        return np.column_stack([age * fading, 1.0 - (1.0 + age) * fading])

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return [{**session_of(motion.samples), 'time': time}
                for time in time_constants(motion.samples)]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        return refined_time(setting, step, time_constants(motion.samples))

    def untestable(self, motion: Motion, joint: int) -> str | None:
        longest = longest_session(motion.samples)
        if longest < _MIN_DURATION:
            return f'the longest session takes {longest:.3g} s, too short for a drift'
        return None


class TimeDelay(Effect):
    """The column is -dg_n/dt in N·m/s, by the chain rule over all joints."""

    name = 'time_delay'
    title = 'Time delay of the torque signal'
    family = 'timing'
    equation = 'tau_n = -T sum_j dg_n/dq_j qd_j'
    description = ('Torque signal that is later than the position signal (earlier, if negative). '
                   'Only the delay of gravity is modelled; delayed friction resembles presliding '
                   'hysteresis.')
    coefficients = (Coefficient('T', 's', 'delay of torque relative to position'),)
    confounders = ('viscous_friction', 'presliding_hysteresis')
    experiment = ('move joint {joint} back and forth over the same path at two speeds, with high '
                  'load and without load; a delay is identifiable with load only')
    signature = 'speed'
    needs = Needs.SPEED
    source = 'Yu 2022, Eq. (18) (slow motion against poses at rest); first-order expansion'
    largest = 0.5
    why_not_larger = 'no bus has such a delay; compare the clocks of the two signals'
    std = 0.02

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return -np.einsum('mj,mj->m', motion.gradient[:, joint], motion.samples.qd)[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        rate = float(np.sqrt(np.mean(self.columns(motion, joint, {}) ** 2)))
        if rate < _MIN_RATE:
            return f'the gravity torque changes too slowly on this joint ({rate:.2g} N·m/s)'
        return None


EFFECTS = (TorqueOffset(), TorqueGain(), TorqueDrift(), TimeDelay())
