"""
Friction of lubricated surfaces, which does not follow the speed in proportion.

At creeping speed the surfaces touch (Stribeck); fast ones slide on a film that shears more easily
the faster it is sheared. Both come beside Coulomb or viscous friction.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation as facts
from gravity_comp_ros.effects.effect import Coefficient, Effect, Setting
from gravity_comp_ros.effects.friction import DRY
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# A Stribeck speed must be this many sign widths, or it only corrects the width.
_ABOVE_WIDTH = 4.0
# ... and lie below this share of the top speed, or it is viscous friction upside down.
_BELOW_TOP = 0.35
_STRIBECK_SPEEDS = 5
# Powers of the speed between 0, Coulomb friction, and 1, viscous friction.
_POWERS = (1.0 / 3.0, 0.5, 2.0 / 3.0)
# Speeds must differ by this factor, or a power of them is a straight line.
_LEAST_SPEED_RATIO = 2.5


class StribeckFriction(Effect):
    """Speeds are tried between the sign width and the speeds that occur."""

    name = 'stribeck_friction'
    title = 'Stribeck friction'
    family = 'friction'
    equation = 'tau_n = F_s d_n exp(-(qd_n / v_s)^2)'
    description = ('Extra friction at creeping speed that falls off as the joint moves faster; '
                   'it comes on top of Coulomb friction.')
    coefficients = (Coefficient('F_s', 'N·m', 'friction at creeping speed beyond Coulomb'),)
    confounders = ('coulomb_friction', 'viscous_friction', 'degressive_friction',
                   'presliding_hysteresis')
    experiment = ('move joint {joint} to and fro through the same range at five speeds, from '
                  'the slowest that the drive holds steady to ten times that')
    signature = 'speed'
    source = ('R. Stribeck, Die wesentlichen Eigenschaften der Gleit- und Rollenlager, 1902; '
              'B. Bona, M. Indri, Friction compensation in robotics: an overview, CDC 2005')
    setting_units = {'speed': 'rad/s'}
    corrects = DRY
    pointwise = True
    why_not_negative = 'friction that rises from creeping speed is viscous, not Stribeck'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        fall = np.exp(-(motion.samples.qd[:, joint] / setting['speed']) ** 2)
        return (motion.direction(joint) * fall)[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        low, high = _stribeck_range(motion, joint)
        if high <= low:
            return []
        count = min(_STRIBECK_SPEEDS, 2 + int(np.log(high / low) / np.log(1.5)))
        return [{'speed': float(v)} for v in np.geomspace(low, high, count)]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        low, high = _stribeck_range(motion, joint)
        return [{'speed': float(np.clip(setting['speed'] * f, low, high))} for f in (0.8, 1.25)]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if reason := facts.insufficient_speeds(motion, joint):
            return reason
        low, high = _stribeck_range(motion, joint)
        if high <= low:
            return (f'a Stribeck speed could be told only from {low:.2g} to {high:.2g} rad/s: '
                    f'the joint is too slow, or its speed too noisy')
        speeds = np.abs(motion.samples.qd[:, joint])
        if np.count_nonzero(speeds < 0.5 * high) < 20:
            return 'too few samples at creeping speed'
        return None


def _stribeck_range(motion: Motion, joint: int) -> tuple[float, float]:
    return (_ABOVE_WIDTH * float(motion.sign_width[joint]),
            _BELOW_TOP * facts.top_speed(motion, joint))


class DegressiveFriction(Effect):
    name = 'degressive_friction'
    title = 'Friction that grows less and less with speed'
    family = 'friction'
    equation = 'tau_n = F_d d_n |qd_n|^p, p = 1/3, 1/2 or 2/3'
    description = ('Friction of a lubricated gear, such as a harmonic drive: it grows fast with a '
                   'low speed and slowly with a high one, because grease gets thinner as it is '
                   'sheared.')
    coefficients = (Coefficient('F_d', 'N·m', 'the torque at 1 rad/s'),)
    confounders = ('coulomb_friction', 'viscous_friction', 'stribeck_friction', 'friction_drift')
    experiment = ('move joint {joint} to and fro through the same range at five speeds, each '
                  'twice the one before')
    signature = 'speed'
    source = ('S. Wolf, M. Iskandar, Extending a dynamic friction model with nonlinear viscous '
              'and thermal dependency for a motor and harmonic drive gear, ICRA 2018')
    setting_units = {'power': ''}
    corrects = ('coulomb_friction', 'viscous_friction')
    pointwise = True
    why_not_negative = 'friction grows with speed here, less than in proportion to it'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        speed = np.abs(motion.samples.qd[:, joint])
        return (motion.direction(joint) * speed ** setting['power'])[:, None]

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        return [{'power': power} for power in _POWERS]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if reason := facts.insufficient_speeds(motion, joint):
            return reason
        speeds = np.abs(motion.samples.qd[facts.moving(motion, joint), joint])
        low, high = np.quantile(speeds, (0.1, 0.9))
        if high < _LEAST_SPEED_RATIO * low:
            return (f'speeds from {low:.2g} to {high:.2g} rad/s are too alike to tell a curve '
                    f'from a straight line')
        return None


EFFECTS = (StribeckFriction(), DegressiveFriction())
