"""Elastic effects: joint springs, cables, end stops, and joint elasticity."""

from __future__ import annotations

from gravity_comp_ros.data.samples import BoolArray, FloatArray
from gravity_comp_ros.effects import excitation
from gravity_comp_ros.effects.effect import (
    Coefficient, Coefficients, Effect, Needs, Setting)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.refining import FACTOR
import numpy as np

# Minimum travel in rad: over less, a spring is collinear with the sine of gravity.
_MIN_TRAVEL = 0.2
# Maximum distance in rad from the middle of the motion to the rest angle of a spring: 360 degrees.
_MAX_REST_ANGLE = 2.0 * np.pi
# Parts of the range in which a cable is slack.
_CABLE_STARTS = (0.2, 0.35, 0.5, 0.65, 0.8)
# Limits of these parts: one that is taut, or slack, over the whole range is another effect.
_SLACK = (0.1, 0.9)
# Exponent of the hardening of a cable or hose over its stretch, and its limits.
_ORDER, _ORDERS = 2.0, (1.25, 3.0)
_HARNESS_RESTS = (0.35, 0.5, 0.65)
# Parts of the range in which an end stop acts; a cable acts over larger parts.
_STOP_DEPTHS = (0.02, 0.04, 0.08, 0.15)
_STIFFNESS = Coefficient('k', 'N·m/rad', 'stiffness')
_REPELS = 'the torque would push the joint away from its rest position'
_WHOLE_RANGE = ('move joint {joint} slowly back and forth over its whole range, once in each of '
                'two postures of the other joints')


class JointSpring(Effect):
    """
    The columns are the angle and the constant of a torsion spring, or harmonics of a crank.

    A spring has a rest angle that the motion need not contain, so its constant is a coefficient
    of its own. The torque of a spring between two points is periodic in the angle. Its
    fundamental is collinear with gravity; the columns are the next harmonics.
    """

    name = 'joint_spring'
    title = 'Joint spring'
    family = 'elastic'
    equation = ('tau_n = k (q_n - c) + m, c the middle of the range; or, on a crank, '
                'sum_i (a_i sin i q_n + b_i cos i q_n), i = 2, 3')
    description = ('Spring that pulls the joint towards a rest angle, such as a stiff hose, or '
                   'spring on a crank, as in a balancer. The rest angle is c - m / k.')
    coefficients = (_STIFFNESS, Coefficient('m', 'N·m', 'torque in the middle of the range'))
    confounders = ('cable_stiffness', 'end_stop', 'torque_offset', 'presliding_hysteresis',
                   'torque_ripple', 'base_tilt')
    experiment = _WHOLE_RANGE
    signature = 'position'
    uses_gravity = False
    needs = Needs.SPEED
    source = 'V. Arakelian, Gravity compensation in robotics, Advanced Robotics 30, 2016'
    setting_units = {'centre': 'rad', 'overtones': ''}
    discrete = ('overtones',)
    is_static = True
    resembles_gravity = True
    shares = (0.3,)
    why_not_negative = _REPELS

    def positive(self, setting: Setting, count: int) -> BoolArray:
        return np.arange(count) == (-1 if _is_crank(setting) else 0)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        q = motion.samples.q[:, [joint]]
        if not _is_crank(setting):
            return np.column_stack([q - setting['centre'], np.ones(len(q))])
        orders = np.arange(2, int(setting['overtones']) + 2)
        return np.column_stack([np.sin(orders * q), np.cos(orders * q)])

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return a torsion spring, and cranks with 1 and 2 harmonics."""
        low, span = _range(motion, joint)
        return [{'centre': low + 0.5 * span, 'overtones': count} for count in (0.0, 1.0, 2.0)]

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        if not _is_crank(setting):
            return self.coefficients
        orders = range(2, int(setting['overtones']) + 2)
        return tuple(Coefficient(f'{symbol}_{order}', 'N·m', f'{wave} of {order} q_n')
                     for symbol, wave in (('a', 'sine'), ('b', 'cosine')) for order in orders)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return _insufficient_travel(motion, joint)

    def implausible(self, values: FloatArray, setting: Setting) -> str | None:
        k, m = (1.0, 0.0) if _is_crank(setting) else np.abs(values)
        if m > _MAX_REST_ANGLE * k:
            return ('its rest angle is more than 360 degrees from the motion: it is a constant '
                    'torque')
        return super().implausible(values, setting)


def _is_crank(setting: Setting) -> bool:
    return bool(setting.get('overtones', 0.0))


def _insufficient_travel(motion: Motion, joint: int) -> str | None:
    travel = excitation.travel(motion, joint)
    if travel < _MIN_TRAVEL:
        return (f'the joint travels {travel:.2g} rad; an elastic torque requires at least '
                f'{_MIN_TRAVEL:g} rad')
    return None


def _hinge(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    """Return the signed distance (M, 1) of the joint beyond `start` in the direction `side`."""
    beyond = setting['side'] * (motion.samples.q[:, [joint]] - setting['start'])
    return setting['side'] * np.maximum(beyond, 0.0)


def _range(motion: Motion, joint: int) -> tuple[float, float]:
    q = motion.samples.q[:, joint]
    return float(q.min()), float(np.ptp(q))


class CableStiffness(Effect):
    """
    The column is the pull of a cable that is taut on one side, or, for side 0, of a harness.

    The pull hardens: a part `hardening` of it grows with the power `order` of the stretch. As one
    coefficient scales both parts, a cable never pushes and never softens, at any angle. It is the
    stiffness, torque over angle, at `half`, half the travel, from the start.
    """

    name = 'cable_stiffness'
    title = 'Cable or hose stiffness'
    family = 'elastic'
    equation = ('tau_n = s k e (1 - w + w (|e| / h)^(p - 1)), e = max(0, s (q_n - q_0)), s = ±1; '
                'or, for s = 0, k e (e / h)^2, e = q_n - q_0; h half the travel, p the order, '
                'w the hardening')
    description = ('Cable that is slack over part of the range and pulls beyond it, or harness '
                   'that stiffens as it is twisted.')
    coefficients = (Coefficient('k', 'N·m/rad', 'stiffness at half the travel from the start'),)
    confounders = ('joint_spring', 'end_stop', 'torque_offset', 'torque_ripple')
    experiment = f'{_WHOLE_RANGE}; if possible, once with the cables removed'
    signature = 'position'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley, 1979 (one-sided and '
              'cubic stiffness)')
    setting_units = {'start': 'rad', 'side': '', 'half': 'rad', 'order': '', 'hardening': ''}
    discrete = ('side',)
    is_static = True
    resembles_gravity = True
    why_not_negative = _REPELS
    shares = (0.5,)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        stretch = (_hinge(motion, joint, setting) if setting['side']
                   else motion.samples.q[:, [joint]] - setting['start'])
        hardened = (np.abs(stretch) / setting['half']) ** (setting['order'] - 1.0)
        part = setting['hardening']
        return np.asarray(stretch * (1.0 - part + part * hardened))

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return starts within the range on both sides, and rest angles of a harness."""
        low, span = _range(motion, joint)

        def setting(part: float, side: float, order: float, hardening: float) -> dict[str, float]:
            return {'start': low + part * span, 'side': side, 'half': max(0.5 * span, 1e-9),
                    'order': order, 'hardening': hardening}

        return [*(setting(part if side > 0 else 1.0 - part, side, _ORDER, 0.0)
                  for side in (1.0, -1.0) for part in _CABLE_STARTS),
                *(setting(rest, 0.0, 3.0, 1.0) for rest in _HARNESS_RESTS)]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        low, span = _range(motion, joint)
        start, (least, most) = setting['start'], _SLACK
        starts = [{**setting, 'start': min(max(moved, low + least * span), low + most * span)}
                  for moved in (start - 0.06 * step * span, start + 0.06 * step * span)]
        if not setting['side']:
            return starts
        return [*starts, *({**setting, name: float(np.clip(setting[name] + change, *limits))}
                           for name, size, limits in (('order', 0.25 * step, _ORDERS),
                                                      ('hardening', 0.25 * step, (0.0, 1.0)))
                           for change in (-size, size))]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return _insufficient_travel(motion, joint)


class EndStop(Effect):
    """The start of the stop is compared at several positions near both ends of the range."""

    name = 'end_stop'
    title = 'End stop'
    family = 'elastic'
    equation = 'tau_n = k s max(0, s (q_n - q_0)), s = ±1, q_0 near an end of the range'
    description = 'Elastic buffer that the joint contacts at an end of its range.'
    coefficients = (Coefficient('k', 'N·m/rad', 'stiffness of the buffer'),)
    confounders = ('cable_stiffness', 'joint_spring', 'torque_ripple')
    experiment = ('move joint {joint} slowly into the end of its range and back several times, '
                  'in different postures of the other joints')
    signature = 'position'
    uses_gravity = False
    needs = Needs.SPEED
    source = ('B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016 (unilateral compliant '
              'contact)')
    setting_units = {'start': 'rad', 'side': ''}
    discrete = ('side',)
    is_static = True
    resembles_gravity = True
    why_not_negative = _REPELS
    shares = (5.0,)

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return _hinge(motion, joint, setting)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        low, span = _range(motion, joint)
        return [{'start': low + (1.0 - depth if side > 0 else depth) * span, 'side': side}
                for side in (1.0, -1.0) for depth in _STOP_DEPTHS]

    def refine(self, motion: Motion, joint: int, setting: Setting,
               step: float) -> list[dict[str, float]]:
        low, span = _range(motion, joint)
        end = low + span if setting['side'] > 0 else low
        depth, deepest = setting['start'] - end, max(_STOP_DEPTHS) * span
        return [{**setting, 'start': end + factor * depth}
                for factor in (FACTOR ** -step, FACTOR ** step)
                if abs(factor * depth) <= deepest]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if reason := _insufficient_travel(motion, joint):
            return reason
        low, span = _range(motion, joint)
        q, deepest = motion.samples.q[:, joint], max(_STOP_DEPTHS)
        near = min(np.count_nonzero(q < low + deepest * span),
                   np.count_nonzero(q > low + (1.0 - deepest) * span))
        if near < 10:
            return 'there are too few samples near the ends of the range'
        return None


class JointFlexibility(Effect):
    """
    The columns are the change of all torques per compliance c if the joint deflects by -c g_j.

    g(q - c g_j e_j) - g(q) = -c g_j dg/dq_j to first order.
    """

    name = 'joint_flexibility'
    title = 'Joint elasticity'
    family = 'elastic'
    equation = 'tau = -c g_n(q) dg(q)/dq_n'
    description = ('Gear that deflects under load, so that the link is lower than the motor '
                   'encoder indicates; the torque of all joints changes.')
    coefficients = (Coefficient('c', 'rad/(N·m)', 'compliance of the gear'),)
    confounders = ('encoder_offset',)
    experiment = ('in the pose with the largest load on joint {joint}, compare the angle of the '
                  'link, measured with an inclinometer, with that of the encoder, with and '
                  'without a known load')
    signature = 'load'
    needs = Needs.SPEED
    source = ('M. W. Spong, Modeling and control of elastic joint robots, ASME Journal of Dynamic '
              'Systems, Measurement and Control 109, 1987')
    scope = 'arm'
    is_static = True
    resembles_gravity = True
    size = 0.02
    why_not_negative = 'the link would deflect against its load'
    largest = 0.01
    why_not_larger = 'no gear deflects by half a degree per newton metre'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return -(motion.gradient[:, :, joint] * motion.gravity[:, [joint]])[:, :, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if float(np.abs(self.columns(motion, joint, {})).max(initial=0.0)) < 1e-6:
            return 'this joint carries no gravity torque that could deflect it'
        return _insufficient_travel(motion, joint)


EFFECTS = (JointSpring(), CableStiffness(), EndStop(), JointFlexibility())
