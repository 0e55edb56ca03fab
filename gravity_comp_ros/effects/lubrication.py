"""
Nonlinear friction of lubricated surfaces.

At low speed the surfaces are in contact (Stribeck friction). At high speed they slide on a film
with shear thinning (degressive friction). Both add to Coulomb or viscous friction.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import Coefficient, Effect, Needs, Setting
from gravity_comp_ros.effects.friction import DRY
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_direction import law_of, LAW_UNITS, refined_laws, WIDTHS
from gravity_comp_ros.effects.refining import scaled
import numpy as np

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


EFFECTS = (StribeckFriction(), DegressiveFriction())
