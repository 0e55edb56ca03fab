"""
Friction effects of one joint.

The direction of motion d, from -1 to 1, is a smoothed sign (`motion_direction`); its law is a
nonlinear setting. The load is the predicted gravity torque, never the measured one, which includes
the friction itself.

Lubricated surfaces are in contact at low speed (Stribeck friction) and slide on a film with shear
thinning at high speed (degressive friction). Both add to Coulomb or viscous friction.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import Coefficient, Effect, Needs, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import law_of, LAW_UNITS, laws, refined_laws, WIDTHS
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
# Minimum Stribeck speed relative to the lowest speed with a certain direction.
_ABOVE_WIDTH = 2.0
# Maximum Stribeck speed relative to the top speed: above, it is collinear with viscous friction.
_BELOW_TOP = 0.7
_STRIBECK_SPEEDS = 4
# Distances in rad over which its direction reverses, if it persists at rest.
_DISTANCES = (0.0001, 0.0004, 0.0015)
# Exponents of the speed between 0, Coulomb friction, and 1, viscous friction.
_POWERS = (1.0 / 3.0, 0.5, 2.0 / 3.0)
# Minimum ratio of speeds: below, a power of the speed is nearly linear.
_MIN_SPEED_RATIO = 2.5


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
    is_common = True
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
    is_common = True
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


class StribeckFriction(Effect):
    """Stribeck speeds between the sign width and the top speed are compared."""

    name = 'stribeck_friction'
    title = 'Stribeck friction'
    family = 'friction'
    equation = 'tau_n = F_s d_n exp(-(qd_n / v_s)^2)'
    description = ('Additional friction at low speed that decreases with speed. It adds to '
                   'Coulomb friction.')
    coefficients = (Coefficient('F_s', 'N·m', 'friction at low speed in excess of Coulomb '
                                              'friction'),)
    confounders = ('coulomb_friction', 'viscous_friction', 'degressive_friction',
                   'presliding_hysteresis')
    experiment = ('move joint {joint} back and forth over the same range at five speeds, from the '
                  'lowest steady speed of the drive to ten times that speed')
    signature = 'speed'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('R. Stribeck, Die wesentlichen Eigenschaften der Gleit- und Rollenlager, 1902; '
              'B. Bona, M. Indri, Friction compensation in robotics: an overview, CDC 2005')
    setting_units = {'speed': 'rad/s', **LAW_UNITS}
    common = tuple(LAW_UNITS)
    corrects = DRY
    size = 0.05
    why_not_negative = 'friction that increases from low speed on is viscous friction'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        fall = np.exp(-(motion.samples.qd[:, joint] / setting['speed']) ** 2)
        return (motion.direction(joint, law_of(setting)) * fall)[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return speeds, each with directions that vanish or persist at rest."""
        low, high = _stribeck_range(motion, joint)
        if high <= low:
            return []
        count = min(_STRIBECK_SPEEDS, 2 + int(np.log(high / low) / np.log(1.5)))
        return [{'speed': float(v), **law} for v in np.geomspace(low, high, count)
                for law in (_narrowest(motion, joint), *({'distance': d} for d in _DISTANCES))]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        low, high = _stribeck_range(motion, joint)
        return [*scaled(setting, 'speed', step, low, high),
                *refined_laws(setting, step, float(motion.speed_noise[joint]))]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if reason := excitation.insufficient_speeds(motion, joint):
            return reason
        low, high = _stribeck_range(motion, joint)
        if high <= low:
            return (f'the joint is too slow, or its speed too noisy: a Stribeck speed must lie '
                    f'above {low:.2g} and below {high:.2g} rad/s')
        speeds = np.abs(motion.samples.qd[:, joint])
        if np.count_nonzero(speeds < 0.5 * high) < 20:
            return 'there are too few samples at low speed'
        return None


def _narrowest(motion: Motion, joint: int) -> dict[str, float]:
    """Return the narrowest law of a direction that the noise of the speed allows."""
    return {'width': max(WIDTHS[0], float(motion.speed_noise[joint]))}


def _stribeck_range(motion: Motion, joint: int) -> tuple[float, float]:
    return (_ABOVE_WIDTH * motion.min_speed(joint),
            _BELOW_TOP * excitation.top_speed(motion, joint))


class DegressiveFriction(Effect):
    name = 'degressive_friction'
    title = 'Degressive viscous friction'
    family = 'friction'
    equation = 'tau_n = F_d d_n |qd_n|^p, p = 1/3, 1/2 or 2/3'
    description = ('Friction of a lubricated gear, such as a harmonic drive, that grows less than '
                   'proportionally to speed because of shear thinning of the grease.')
    coefficients = (Coefficient('F_d', 'N·m', 'friction torque at 1 rad/s'),)
    confounders = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'friction_drift')
    experiment = ('move joint {joint} back and forth over the same range at five speeds, each '
                  'twice the previous one')
    signature = 'speed'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('S. Wolf, M. Iskandar, Extending a dynamic friction model with nonlinear viscous '
              'and thermal dependency for a motor and harmonic drive gear, ICRA 2018')
    setting_units = {'power': '', **LAW_UNITS}
    corrects = ('coulomb_friction', 'viscous_friction')
    why_not_negative = 'this friction increases with speed'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        speed = np.abs(motion.samples.qd[:, joint])
        direction = motion.direction(joint, law_of(setting))
        return (direction * speed ** setting['power'])[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return [{'power': power, **_narrowest(motion, joint)} for power in _POWERS]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if reason := excitation.insufficient_speeds(motion, joint):
            return reason
        speeds = np.abs(motion.samples.qd[excitation.moving(motion, joint), joint])
        low, high = np.quantile(speeds, (0.1, 0.9))
        if high < _MIN_SPEED_RATIO * low:
            return (f'the range of speeds, {low:.2g} to {high:.2g} rad/s, is too narrow to '
                    f'distinguish a nonlinear from a linear law')
        return None


EFFECTS = (CoulombFriction(), ViscousFriction(), AsymmetricFriction(), LoadDependentFriction(),
           CoupledFriction(), StribeckFriction(), DegressiveFriction())
