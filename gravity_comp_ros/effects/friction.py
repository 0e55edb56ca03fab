"""
Friction effects of one joint.

The direction of motion d, from -1 to 1, is a smoothed sign (`motion_direction`); its law is a
nonlinear setting. The load is the predicted gravity torque, never the measured one, which includes
the friction itself.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import Coefficient, Effect, Expectation, Needs, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import law_of, LAW_UNITS, laws, refined_laws
from gravity_comp_ros.effects.refining import scaled
import numpy as np

_THREE_SPEEDS = ('move joint {joint} back and forth over its range at three speeds, with the '
                 'other joints at rest')
# Effects that are corrected by friction at low speed.
DRY = ('coulomb_friction', 'load_dependent_friction', 'coupled_friction')
_DISSIPATES = 'friction dissipates energy'
# Relative asymmetry of friction with which a search starts, and its range.
_SKEW, _SKEWS = 0.4, (0.05, 0.9)
# Transmitted friction with which a search starts, as a share of the largest load.
_TRANSMITTED = 0.1


class DirectionEffect(Effect):
    """Friction whose direction follows one of the laws; the law is among its settings."""

    setting_units = LAW_UNITS
    common = tuple(LAW_UNITS)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return laws(float(motion.speed_noise[joint]))

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        return refined_laws(setting, step, float(motion.speed_noise[joint]))

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return excitation.insufficient_directions(motion, joint)


class CoulombFriction(DirectionEffect):
    name = 'coulomb_friction'
    title = 'Coulomb friction'
    family = 'friction'
    equation = 'tau_n = F_c d_n'
    description = 'Constant torque that opposes the motion.'
    coefficients = (Coefficient('F_c', 'N·m', 'Coulomb friction torque'),)
    confounders = ('viscous_friction', 'stribeck_friction', 'degressive_friction',
                   'load_dependent_friction', 'presliding_hysteresis', 'asymmetric_friction',
                   'torque_offset', 'coupled_friction', 'friction_drift')
    experiment = _THREE_SPEEDS
    signature = 'speed'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('C. A. Coulomb, Théorie des machines simples, 1785; H. Olsson et al., Friction '
              'models and friction compensation, European Journal of Control 4, 1998')
    expectation = Expectation.COMMON
    why_not_negative = _DISSIPATES
    shares = (0.1,)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.direction(joint, law_of(setting))[:, None]


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
    uses_gravity = False
    needs = Needs.SPEED
    source = ('H. Olsson et al., Friction models and friction compensation, European Journal of '
              'Control 4, 1998')
    expectation = Expectation.COMMON
    why_not_negative = _DISSIPATES
    shares = (1.0,)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return motion.samples.qd[:, [joint]]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return excitation.insufficient_speeds(motion, joint)


class AsymmetricFriction(DirectionEffect):
    """
    With a direction that persists at rest, the level of Dahl's element differs by direction.

    `skew` is the difference of the levels relative to their sum: F_a / F_c.
    """

    name = 'asymmetric_friction'
    title = 'Asymmetric friction'
    family = 'friction'
    equation = "tau_n = F_a |d_n|, or F_a (z_n(skew) - z_n(0)) / skew, z_n of Dahl's element"
    description = ('Friction that is larger in one direction than in the other. In motion it is '
                   'equal to an offset; at rest it vanishes or persists as the friction does.')
    coefficients = (Coefficient('F_a', 'N·m', 'half the difference of friction in positive and '
                                              'negative direction'),)
    confounders = ('torque_offset', 'coulomb_friction')
    experiment = ('move joint {joint} back and forth and stop for some seconds at several '
                  'positions')
    signature = 'speed'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('B. Armstrong-Hélouvry et al., A survey of models, analysis tools and compensation '
              'methods for the control of machines with friction, Automatica 30, 1994')
    setting_units = {'skew': '', **LAW_UNITS}
    corrects = DRY
    shares = (0.05,)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        law = law_of(setting)
        d = motion.direction(joint, law)
        if 'distance' not in law:
            return np.abs(d)[:, None]
        skewed = motion.direction(joint, {**law, 'skew': setting['skew']})
        return ((skewed - d) / setting['skew'])[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return [{**law, 'skew': _SKEW} for law in super().settings(motion, joint)]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        skewed = scaled(setting, 'skew', step, *_SKEWS) if 'distance' in setting else []
        return [*super().refine(motion, joint, setting, step), *skewed]


class LoadDependentFriction(DirectionEffect):
    """The load is gravity and, with `friction` F in N·m, the other friction of the joint."""

    name = 'load_dependent_friction'
    title = 'Load-dependent friction'
    family = 'friction'
    equation = 'tau_n = mu |g_n(q) + F d_n| d_n'
    description = ('Friction proportional to the torque that the gear transmits: gravity and, '
                   'with the setting `friction`, other friction F of the joint. F acts as a '
                   'small gain.')
    coefficients = (Coefficient('mu', '', 'friction torque per transmitted torque'),)
    confounders = ('coulomb_friction', 'torque_gain')
    experiment = ('move joint {joint} back and forth over a short range in a pose with high load '
                  'and in one without load')
    signature = 'load'
    needs = Needs.SPEED
    source = ('A. C. Bittencourt, S. Gunnarsson, Static friction in a robot joint: modeling and '
              'identification of load and temperature effects, ASME Journal of Dynamic Systems, '
              'Measurement and Control 134, 2012')
    setting_units = {'friction': 'N·m', **LAW_UNITS}
    why_not_negative = _DISSIPATES
    largest = 0.5
    why_not_larger = 'no usable gear loses half of the transmitted torque'
    std = 0.1

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        d = motion.direction(joint, law_of(setting))
        load = motion.gravity[:, joint] + setting.get('friction', 0.0) * d
        return (np.abs(load) * d)[:, None]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        start = _TRANSMITTED * float(np.abs(motion.gravity[:, joint]).max())
        known = {'friction': start, **setting}
        return [*super().refine(motion, joint, setting, step), *scaled(known, 'friction', step),
                *([] if 'friction' in setting else [known])]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return super().untestable(motion, joint) or excitation.insufficient_load(
            np.abs(motion.gravity[:, joint]))


class CoupledFriction(DirectionEffect):
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
    uses_gravity = False
    needs = Needs.SPEED
    source = ('W. Khalil, E. Dombre, Modeling, Identification and Control of Robots, Hermes '
              'Penton, 2002 (kinematic coupling between wrist motors)')
    setting_units = {'partner': 'joint number', 'sign': '', **LAW_UNITS}
    discrete = ('partner', 'sign')
    common = ()
    why_not_negative = _DISSIPATES
    shares = (0.1,)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        coupled = {joint: 1.0, int(setting['partner']) - 1: setting['sign']}
        return motion.coupled_direction(coupled, law_of(setting))[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return the neighbours and signs with some of the laws."""
        partners = [m for m in (joint - 1, joint + 1) if 0 <= m < motion.samples.n_joints]
        return [{'partner': m + 1.0, 'sign': sign, **law} for m in partners for sign in (1.0, -1.0)
                for law in laws(float(motion.speed_noise[joint]))[1::4]]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.samples.n_joints < 2:
            return 'a coupled gear requires a second joint'
        return super().untestable(motion, joint)


EFFECTS = (CoulombFriction(), ViscousFriction(), AsymmetricFriction(), LoadDependentFriction(),
           CoupledFriction())
