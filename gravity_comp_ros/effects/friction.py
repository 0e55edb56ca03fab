"""
Friction of one joint: what turns with the direction of motion.

The direction d, from -1 to 1, turns as the data shows (`direction`). Load is the predicted gravity
torque, never the measured one, which holds the friction itself.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation as facts
from gravity_comp_ros.effects.effect import Coefficient, Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import direction, find_shape, least_widths, Shape
from gravity_comp_ros.models.least_squares import lstsq
import numpy as np

_TO_AND_FRO = ('move joint {joint} to and fro through its range with the others still, once '
               'each at three speeds')
# What friction at creeping speed corrects.
DRY = ('coulomb_friction', 'load_dependent_friction', 'coupled_friction')
_PUSHES = 'friction takes energy from the motion, it never adds any'
# What own and partner's friction must leave of a coupled direction, which is ±1.
_OWN_DIRECTION = 0.2


class CoulombFriction(Effect):
    name = 'coulomb_friction'
    title = 'Coulomb friction'
    family = 'friction'
    equation = 'tau_n = F_c d_n'
    description = ('A constant torque against the motion; the prediction jumps where the joint '
                   'turns back.')
    coefficients = (Coefficient('F_c', 'N·m', 'Coulomb friction torque'),)
    confounders = ('viscous_friction', 'stribeck_friction', 'degressive_friction',
                   'load_dependent_friction', 'presliding_hysteresis', 'asymmetric_friction',
                   'torque_offset', 'coupled_friction', 'friction_drift')
    experiment = _TO_AND_FRO
    signature = 'speed'
    source = ('C. A. Coulomb, Théorie des machines simples, 1785; H. Olsson et al., Friction '
              'models and friction compensation, European Journal of Control 4, 1998')
    pointwise = True
    expectation = Expectation.COMMON
    why_not_negative = _PUSHES

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.direction(joint)[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return facts.lacks_both_ways(motion, joint)


class ViscousFriction(Effect):
    name = 'viscous_friction'
    title = 'Viscous friction'
    family = 'friction'
    equation = 'tau_n = F_v qd_n'
    description = 'A torque against the motion that grows in proportion to speed.'
    coefficients = (Coefficient('F_v', 'N·m·s/rad', 'viscous friction coefficient'),)
    confounders = ('coulomb_friction', 'stribeck_friction', 'degressive_friction',
                   'presliding_hysteresis', 'time_delay', 'coupled_friction', 'friction_drift')
    experiment = _TO_AND_FRO
    signature = 'speed'
    source = ('H. Olsson et al., Friction models and friction compensation, European Journal of '
              'Control 4, 1998')
    pointwise = True
    expectation = Expectation.COMMON
    why_not_negative = _PUSHES

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.samples.qd[:, [joint]]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return facts.insufficient_speeds(motion, joint)


class AsymmetricFriction(Effect):
    name = 'asymmetric_friction'
    title = 'Friction that differs by direction'
    family = 'friction'
    equation = 'tau_n = F_a |d_n|'
    description = ('Friction that is stronger one way than the other; in motion it looks like an '
                   'offset, which is gone when the joint stands.')
    coefficients = (Coefficient('F_a', 'N·m', 'half the difference of friction upwards and '
                                              'downwards'),)
    confounders = ('torque_offset', 'coulomb_friction')
    experiment = ('move joint {joint} to and fro and let it stand for some seconds in several '
                  'places on the way')
    signature = 'speed'
    source = ('B. Armstrong-Hélouvry et al., A survey of models, analysis tools and compensation '
              'methods for the control of machines with friction, Automatica 30, 1994')
    corrects = DRY
    pointwise = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return np.abs(motion.direction(joint))[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return facts.lacks_holds(motion, joint)


class LoadDependentFriction(Effect):
    name = 'load_dependent_friction'
    title = 'Friction that grows with load'
    family = 'friction'
    equation = 'tau_n = mu |g_n(q)| d_n'
    description = 'Friction in proportion to the gravity torque that the gear carries.'
    coefficients = (Coefficient('mu', '', 'friction torque per torque carried'),)
    confounders = ('coulomb_friction', 'torque_gain')
    experiment = ('move joint {joint} to and fro over a short way in a pose with much load and '
                  'in one with none')
    signature = 'load'
    source = ('A. C. Bittencourt, S. Gunnarsson, Static friction in a robot joint: modeling and '
              'identification of load and temperature effects, ASME Journal of Dynamic Systems, '
              'Measurement and Control 134, 2012')
    pointwise = True
    why_not_negative = _PUSHES
    largest = 0.5
    why_not_larger = 'no gear that can be driven loses half its load'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return (np.abs(motion.gravity[:, joint]) * motion.direction(joint))[:, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        reason = facts.lacks_both_ways(motion, joint) or facts.insufficient_load(motion, joint)
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
    title = 'Friction of a coupled gear'
    family = 'friction'
    equation = 'tau_n = F_k d(q_n + s q_m), m a neighbour of n, s = ±1'
    description = ('Friction that turns with the sum or difference of two joint speeds, as in a '
                   'wrist whose motors drive two joints together.')
    coefficients = (Coefficient('F_k', 'N·m', 'friction torque of the shared gear'),)
    confounders = ('coulomb_friction', 'viscous_friction')
    experiment = ('move joint {joint} and its neighbour to and fro together, first the same way '
                  'at one speed, then against each other, then each alone')
    signature = 'speed'
    source = ('W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, Hermes '
              'Penton, 2002 (kinematic coupling between wrist motors)')
    setting_units = {'partner': 'joint number', 'sign': '', 'width': 'rad/s', 'hold': 'rad'}
    not_scanned = ('width', 'hold')
    pointwise = True
    why_not_negative = _PUSHES

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        q, qd = _shared(motion, joint, setting)
        return direction(motion.samples, q, qd, Shape(setting['width'], setting['hold']))[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return the neighbours and signs whose sum of speeds has a direction of its own."""
        partners = [m for m in (joint - 1, joint + 1) if 0 <= m < motion.samples.n_joints]
        found = [_shaped(motion, joint, {'partner': m + 1.0, 'sign': s})
                 for m in partners for s in (1.0, -1.0)]
        return [setting for setting in found if self._differs(motion, joint, setting)]

    def _differs(self, motion: Motion, joint: int, setting: Setting) -> bool:
        partner = int(setting['partner']) - 1
        known = np.column_stack([
            np.ones(motion.samples.n_samples), motion.direction(joint),
            motion.direction(partner), motion.samples.qd[:, [joint, partner]]])
        column = self.columns(motion, joint, setting)[:, 0]
        rest = column - known @ lstsq(known, column)
        return float(rest.std()) > _OWN_DIRECTION

    def untestable(self, motion: Motion, joint: int) -> str | None:
        # Its direction differs from the joint's own near reversals, as hysteresis does.
        reason = facts.lacks_both_ways(motion, joint) or facts.insufficient_reversals(motion, joint)
        if reason or self.settings(motion, joint):
            return reason
        return ('neither neighbour moves together with this joint in such a way that the sum of '
                'their speeds turns at other times than they do')


def _shared(motion: Motion, joint: int, setting: Setting) -> tuple[FloatArray, FloatArray]:
    """Return angle and speed of a gear that the joint shares with its partner, each (M,)."""
    partner, sign = int(setting['partner']) - 1, setting['sign']
    q, qd = motion.samples.q, motion.samples.qd
    return q[:, joint] + sign * q[:, partner], qd[:, joint] + sign * qd[:, partner]


def _shaped(motion: Motion, joint: int, setting: dict[str, float]) -> dict[str, float]:
    """Return a coupling with the shape of its direction."""
    samples, partner = motion.samples, int(setting['partner']) - 1
    least = float(least_widths(samples, [joint, partner]).max())
    residual = samples.tau[:, joint] - motion.gravity[:, joint]
    shape = find_shape(samples, *_shared(motion, joint, setting), motion.qdd[:, joint],
                       residual, least)
    return {**setting, 'width': shape.width, 'hold': shape.hold}


EFFECTS = (CoulombFriction(), ViscousFriction(), AsymmetricFriction(), LoadDependentFriction(),
           CoupledFriction())
