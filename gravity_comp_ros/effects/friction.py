"""
Friction effects of one joint.

The direction of motion d, from -1 to 1, is a smoothed sign (`motion_direction`). The load is the
predicted gravity torque, never the measured one, which includes the friction itself.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import Coefficient, Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import direction, find_shape, min_widths, Shape
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

_THREE_SPEEDS = ('move joint {joint} back and forth over its range at three speeds, with the '
                 'other joints at rest')
# Effects that are corrected by friction at low speed.
DRY = ('coulomb_friction', 'load_dependent_friction', 'coupled_friction')
_DISSIPATES = 'friction dissipates energy'
# Minimum residual, in standard deviations of 1, of a coupled direction after the directions and
# speeds of both joints.
_OWN_DIRECTION = 0.2


class CoulombFriction(Effect):
    name = 'coulomb_friction'
    title = 'Coulomb friction'
    family = 'friction'
    equation = 'tau_n = F_c d_n'
    description = ('Constant torque that opposes the motion. The predicted torque jumps at a '
                   'reversal.')
    coefficients = (Coefficient('F_c', 'N·m', 'Coulomb friction torque'),)
    confounders = ('viscous_friction', 'stribeck_friction', 'degressive_friction',
                   'load_dependent_friction', 'presliding_hysteresis', 'asymmetric_friction',
                   'torque_offset', 'coupled_friction', 'friction_drift')
    experiment = _THREE_SPEEDS
    signature = 'speed'
    source = ('C. A. Coulomb, Théorie des machines simples, 1785; H. Olsson et al., Friction '
              'models and friction compensation, European Journal of Control 4, 1998')
    pointwise = True
    expectation = Expectation.COMMON
    why_not_negative = _DISSIPATES

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.direction(joint)[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return excitation.insufficient_directions(motion, joint)


class ViscousFriction(Effect):
    name = 'viscous_friction'
    title = 'Viscous friction'
    family = 'friction'
    equation = 'tau_n = F_v qd_n'
    description = 'Torque that opposes the motion and is proportional to speed.'
    coefficients = (Coefficient('F_v', 'N·m·s/rad', 'viscous friction coefficient'),)
    confounders = ('coulomb_friction', 'stribeck_friction', 'degressive_friction',
                   'presliding_hysteresis', 'time_delay', 'coupled_friction', 'friction_drift')
    experiment = _THREE_SPEEDS
    signature = 'speed'
    source = ('H. Olsson et al., Friction models and friction compensation, European Journal of '
              'Control 4, 1998')
    pointwise = True
    expectation = Expectation.COMMON
    why_not_negative = _DISSIPATES

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.samples.qd[:, [joint]]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return excitation.insufficient_speeds(motion, joint)


class AsymmetricFriction(Effect):
    name = 'asymmetric_friction'
    title = 'Asymmetric friction'
    family = 'friction'
    equation = 'tau_n = F_a |d_n|'
    description = ('Friction that is larger in one direction than in the other. In motion it is '
                   'equal to an offset; at rest it vanishes.')
    coefficients = (Coefficient('F_a', 'N·m', 'half the difference of friction in positive and '
                                              'negative direction'),)
    confounders = ('torque_offset', 'coulomb_friction')
    experiment = ('move joint {joint} back and forth and stop for some seconds at several '
                  'positions')
    signature = 'speed'
    source = ('B. Armstrong-Hélouvry et al., A survey of models, analysis tools and compensation '
              'methods for the control of machines with friction, Automatica 30, 1994')
    corrects = DRY
    pointwise = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return np.abs(motion.direction(joint))[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return excitation.insufficient_rest(motion, joint)


class LoadDependentFriction(Effect):
    name = 'load_dependent_friction'
    title = 'Load-dependent friction'
    family = 'friction'
    equation = 'tau_n = mu |g_n(q)| d_n'
    description = 'Friction proportional to the gravity torque that the gear transmits.'
    coefficients = (Coefficient('mu', '', 'friction torque per transmitted torque'),)
    confounders = ('coulomb_friction', 'torque_gain')
    experiment = ('move joint {joint} back and forth over a short range in a pose with high load '
                  'and in one without load')
    signature = 'load'
    source = ('A. C. Bittencourt, S. Gunnarsson, Static friction in a robot joint: modeling and '
              'identification of load and temperature effects, ASME Journal of Dynamic Systems, '
              'Measurement and Control 134, 2012')
    pointwise = True
    why_not_negative = _DISSIPATES
    largest = 0.5
    why_not_larger = 'no usable gear loses half of the transmitted torque'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return (np.abs(motion.gravity[:, joint]) * motion.direction(joint))[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        reason = (excitation.insufficient_directions(motion, joint)
                  or excitation.insufficient_load(motion, joint))
        if reason:
            return reason
        d, load = motion.direction(joint), np.abs(motion.gravity[:, joint])
        mean = float(d @ (load * d)) / max(float(d @ d), 1e-300)
        if np.sqrt(np.mean(((load - mean) * d) ** 2)) < 0.05 * max(mean, 0.1):
            return 'the load is nearly the same wherever the joint moves'
        return None


class CoupledFriction(Effect):
    """The column is the direction of q_n + s q_m, m the joint number `partner` (from 1)."""

    name = 'coupled_friction'
    title = 'Coupled-gear friction'
    family = 'friction'
    equation = 'tau_n = F_k d(q_n + s q_m), m a neighbour of n, s = ±1'
    description = ('Coulomb friction that opposes the sum or difference of two joint speeds, as '
                   'in a wrist with a differential gear.')
    coefficients = (Coefficient('F_k', 'N·m', 'friction torque of the coupled gear'),)
    confounders = ('coulomb_friction', 'viscous_friction')
    experiment = ('move joint {joint} and its neighbour back and forth: both in the same '
                  'direction at equal speed, both in opposite directions, and each alone')
    signature = 'speed'
    source = ('W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, Hermes '
              'Penton, 2002 (kinematic coupling between wrist motors)')
    setting_units = {'partner': 'joint number', 'sign': '', 'width': 'rad/s', 'hold': 'rad',
                     'ramp': ''}
    not_scanned = ('width', 'hold', 'ramp')
    pointwise = True
    why_not_negative = _DISSIPATES

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        q, qd = _shared(motion, joint, setting)
        shape = Shape(setting['width'], setting['hold'], bool(setting.get('ramp', 0.0)))
        return direction(motion.samples, q, qd, shape)[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return the neighbours and signs whose coupled direction differs from both joints'."""
        partners = [m for m in (joint - 1, joint + 1) if 0 <= m < motion.samples.n_joints]
        settings = [_shaped(motion, joint, {'partner': m + 1.0, 'sign': s})
                    for m in partners for s in (1.0, -1.0)]
        return [setting for setting in settings if self._differs(motion, joint, setting)]

    def _differs(self, motion: Motion, joint: int, setting: Setting) -> bool:
        partner = int(setting['partner']) - 1
        others = np.column_stack([
            np.ones(motion.samples.n_samples), motion.direction(joint),
            motion.direction(partner), motion.samples.qd[:, [joint, partner]]])
        column = self.columns(motion, joint, setting)[:, 0]
        return float((column - others @ lstsq(others, column)).std()) > _OWN_DIRECTION

    def untestable(self, motion: Motion, joint: int) -> str | None:
        # It differs from Coulomb friction near reversals only.
        reason = (excitation.insufficient_directions(motion, joint)
                  or excitation.insufficient_reversals(motion, joint))
        if reason or self.settings(motion, joint):
            return reason
        return ('with neither neighbour does the sum or difference of speeds reverse at other '
                'times than the speeds themselves')


def _shared(motion: Motion, joint: int, setting: Setting) -> tuple[FloatArray, FloatArray]:
    """Return angle and speed of the gear that couples a joint with its partner, each (M,)."""
    partner, sign = int(setting['partner']) - 1, setting['sign']
    q, qd = motion.samples.q, motion.samples.qd
    return q[:, joint] + sign * q[:, partner], qd[:, joint] + sign * qd[:, partner]


def _shaped(motion: Motion, joint: int, setting: dict[str, float]) -> dict[str, float]:
    """Return the setting of a coupling with the shape of its direction."""
    samples, partner = motion.samples, int(setting['partner']) - 1
    minimum = float(min_widths(samples, [joint, partner]).max())
    residual = samples.tau[:, joint] - motion.gravity[:, joint]
    shape = find_shape(samples, *_shared(motion, joint, setting), motion.qdd[:, joint],
                       residual, minimum)
    return {**setting, 'width': shape.width, 'hold': shape.hold, 'ramp': float(shape.ramp)}


EFFECTS = (CoulombFriction(), ViscousFriction(), AsymmetricFriction(), LoadDependentFriction(),
           CoupledFriction())
