"""What pulls a joint back: springs, cables, end stops, and gears that give way."""

from __future__ import annotations

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects import excitation as facts
from gravity_comp_ros.effects.effect import (
    AlternativeModel, Coefficient, Coefficients, Effect, Expectation, Setting)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.plausibility import too_much_torque
import numpy as np

# Less travel leaves a spring, a ramp and gravity's sine alike.
_LEAST_TRAVEL = 0.2
# Over less of a turn overtones are a parabola, which much else is.
_CRANK_TRAVEL = 1.5
# Parts of the range that a cable may have gone through, slack, where it becomes taut.
_CABLE_STARTS = (0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
# A hose pulls in proportion to its stretch, or more and more.
_CABLE_ORDERS = (1.5, 2.0)
_HARNESS_RESTS = (0.35, 0.5, 0.65)
# Parts of the range, next to an end, over which a stop may act; what acts over more is a cable.
_STOP_DEPTHS = (0.02, 0.04, 0.08, 0.15)
# Part of its largest load below which a gear with play may lie on either flank.
_NO_LOAD = 0.05
_STIFFNESS = Coefficient('k', 'N·m/rad', 'stiffness')
_PULLS = 'it would push the joint away instead of holding it back'


class JointSpring(Effect):
    """
    The column is the angle of a spring of torsion, or the overtones of one that pulls on a crank.

    A spring between two points goes through its torque once a turn: what gravity's own sine
    does not hold of that are the overtones, and the first ones matter.
    """

    name = 'joint_spring'
    title = 'Spring on the joint'
    family = 'elastic'
    equation = ('tau_n = k (q_n - q_0), q_0 the mean of q_n; or, on a crank, '
                'sum_m (a_m sin m q_n + b_m cos m q_n), m = 2, 3')
    description = ('A spring that pulls the joint to some angle, such as a stiff hose; or one '
                   'that pulls on a crank, as in a balancer.')
    coefficients = (_STIFFNESS,)
    confounders = ('cable_stiffness', 'end_stop', 'torque_offset', 'presliding_hysteresis',
                   'torque_ripple', 'base_tilt', 'inertia')
    experiment = ('move joint {joint} slowly to and fro through its whole range, once in each of '
                  'two postures of the others')
    signature = 'position'
    source = 'V. Arakelian, Gravity compensation in robotics, Advanced Robotics 30, 2016'
    setting_units = {'centre': 'rad', 'overtones': ''}
    not_scanned = ('centre', 'overtones')
    pointwise = True
    expectation = Expectation.COMMON
    why_not_negative = _PULLS

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        q = motion.samples.q[:, [joint]]
        if not _is_crank(setting):
            return q - setting['centre']
        orders = np.arange(2, int(setting['overtones']) + 2)
        return np.column_stack([np.sin(orders * q), np.cos(orders * q)])

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return a spring of torsion about the mean angle, and cranks of 1 and 2 overtones."""
        orders = (0.0,) if facts.travel(motion, joint) < _CRANK_TRAVEL else (0.0, 1.0, 2.0)
        centre = float(motion.samples.q[:, joint].mean())
        return [{'centre': centre, 'overtones': count} for count in orders]

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        if not _is_crank(setting):
            return self.coefficients
        orders = range(2, int(setting['overtones']) + 2)
        return tuple(Coefficient(f'{symbol}_{order}', 'N·m', f'{wave} of {order} q_n')
                     for symbol, wave in (('a', 'sine'), ('b', 'cosine')) for order in orders)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return _lacks_travel(motion, joint)

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        if _is_crank(setting):
            # An overtone has either sign.
            return too_much_torque(self.columns(motion, joint, setting) @ np.asarray(values),
                                   motion, joint)
        return super().implausible(values, setting, motion, joint)


def _is_crank(setting: Setting) -> bool:
    return bool(setting.get('overtones', 0.0))


def _lacks_travel(motion: Motion, joint: int) -> str | None:
    reach = facts.travel(motion, joint)
    if reach < _LEAST_TRAVEL:
        return (f'the joint travels {reach:.2g} rad; what pulls it back shows from '
                f'{_LEAST_TRAVEL:g} rad on')
    return None if reach >= _CRANK_TRAVEL else facts.insufficient_postures(motion, joint)


def _hinge(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    """Return how far the joint is beyond `start` towards `side`, with that side's sign."""
    beyond = setting['side'] * (motion.samples.q[:, [joint]] - setting['start'])
    return setting['side'] * np.maximum(beyond, 0.0)


def _range(motion: Motion, joint: int) -> tuple[float, float]:
    q = motion.samples.q[:, joint]
    return float(q.min()), float(np.ptp(q))


class CableStiffness(Effect):
    """
    The column is the pull of a cable that is taut on one side, or for side 0 a cube.

    A cable may grow stiffer as it tightens, by a power of its stretch of more than 1, `order`.
    The cube is that of a harness twisted about its rest at `start`. Both are scaled so that
    their coefficient is a stiffness, too: torque over angle at `half`, half the travel, from
    the start.
    """

    name = 'cable_stiffness'
    title = 'Cable or hose that tightens'
    family = 'elastic'
    equation = ('tau_n = k s e (e / h)^(p - 1), e = max(0, s (q_n - q_0)), s = ±1; or, s = 0, '
                'k (q_n - q_0)^3 / h^2; h half the travel, p the order, 1 to 2')
    description = ('A cable that is slack over part of the range and pulls beyond it, or a '
                   'harness that stiffens as it is twisted.')
    coefficients = (Coefficient('k', 'N·m/rad', 'stiffness when taut'),)
    confounders = ('joint_spring', 'end_stop', 'torque_offset', 'torque_ripple')
    experiment = ('move joint {joint} slowly to and fro through its whole range, once in each of '
                  'two postures of the others; once with the cables taken off, if they can be')
    signature = 'position'
    source = ('A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, Wiley, 1979 (one-sided and '
              'cubic stiffness)')
    setting_units = {'start': 'rad', 'side': '', 'half': 'rad', 'order': ''}
    not_scanned = ('half',)
    pointwise = True
    why_not_negative = _PULLS

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        order = setting.get('order', 1.0)
        if not setting['side']:
            twist = motion.samples.q[:, [joint]] - setting['start']
            return twist * (twist / setting['half']) ** 2
        pull = _hinge(motion, joint, setting)
        return pull if order == 1.0 else pull * (np.abs(pull) / setting['half']) ** (order - 1.0)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return starts within the range, sides and orders, and 3 rest angles of a harness."""
        low, span = _range(motion, joint)

        def setting(part: float, side: float) -> dict[str, float]:
            return {'start': low + part * span, 'side': side, 'half': max(0.5 * span, 1e-9)}

        taut = [setting(part if side > 0 else 1.0 - part, side)
                for side in (1.0, -1.0) for part in _CABLE_STARTS]
        stiffer = [{**one, 'order': order} for order in _CABLE_ORDERS for one in taut]
        return [*taut, *stiffer, *(setting(rest, 0.0) for rest in _HARNESS_RESTS)]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        _, span = _range(motion, joint)
        return [{**setting, 'start': setting['start'] + part * span}
                for part in (-0.06, -0.03, 0.03, 0.06)]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        return _lacks_travel(motion, joint)


class EndStop(Effect):
    """Starts are tried close to either end of the range."""

    name = 'end_stop'
    title = 'End stop'
    family = 'elastic'
    equation = 'tau_n = k s max(0, s (q_n - q_0)), s = ±1, q_0 near an end of the range'
    description = 'A buffer that the joint runs into at an end of its range.'
    coefficients = (Coefficient('k', 'N·m/rad', 'stiffness of the buffer'),)
    confounders = ('cable_stiffness', 'joint_spring', 'torque_ripple')
    experiment = ('move joint {joint} slowly into the end of its range and back several times, '
                  'with other poses of the other joints')
    signature = 'position'
    source = ('B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer, 2016 (unilateral compliant '
              'contact)')
    setting_units = {'start': 'rad', 'side': ''}
    pointwise = True
    why_not_negative = _PULLS

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return _hinge(motion, joint, setting)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        low, span = _range(motion, joint)
        return [{'start': low + (1.0 - depth if side > 0 else depth) * span, 'side': side}
                for side in (1.0, -1.0) for depth in _STOP_DEPTHS]

    def refine(self, motion: Motion, joint: int, setting: Setting) -> list[dict[str, float]]:
        low, span = _range(motion, joint)
        end = low + span if setting['side'] > 0 else low
        depth, most = setting['start'] - end, max(_STOP_DEPTHS) * span
        return [{**setting, 'start': end + factor * depth} for factor in (0.7, 0.85, 1.15, 1.3)
                if abs(factor * depth) <= most]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if reason := _lacks_travel(motion, joint):
            return reason
        low, span = _range(motion, joint)
        q, deepest = motion.samples.q[:, joint], max(_STOP_DEPTHS)
        near = min(np.count_nonzero(q < low + deepest * span),
                   np.count_nonzero(q > low + (1.0 - deepest) * span))
        if near < 10:
            return 'too few samples near the ends of the range'
        return None


class JointFlexibility(Effect):
    """
    The columns are what all joints lose when gravity turns this one by -c g_joint, per c.

    g(q - c g_j e_j) - g(q) = -c g_j dg/dq_j to first order.
    """

    name = 'joint_flexibility'
    title = 'Gear that gives way'
    family = 'elastic'
    equation = 'tau = -c g_n(q) dg(q)/dq_n'
    description = ('A gear that gives way under load, so that the link hangs lower than the motor '
                   'encoder says and all joints carry another torque.')
    coefficients = (Coefficient('c', 'rad/(N·m)', 'compliance of the gear'),)
    confounders = ('encoder_offset',)
    experiment = ('in the pose where joint {joint} carries most, compare the angle that a level '
                  'on the link shows with the one that the encoder gives, with and without a '
                  'known load')
    signature = 'load'
    source = ('M. W. Spong, Modeling and control of elastic joint robots, ASME Journal of Dynamic '
              'Systems, Measurement and Control 109, 1987')
    scope = 'arm'
    pointwise = True
    why_not_negative = 'the link would rise under its load'
    largest = 0.01
    why_not_larger = 'no gear yields half a degree for each newton metre'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return -(motion.gradient[:, :, joint] * motion.gravity[:, [joint]])[:, :, None]

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if float(np.abs(self.columns(motion, joint, {})).max(initial=0.0)) < 1e-6:
            return 'this joint carries no gravity that could bend it'
        return _lacks_travel(motion, joint)

    def alternative(self) -> AlternativeModel:
        return Play(self)


class Play(AlternativeModel):
    """A gear that lies on either flank, however small its load."""

    meaning = ('the joint turns one way or the other with the sign of its load, less in '
               'proportion to it: play, or a gear that gives way at once')

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        load = motion.gravity[:, [joint]]
        largest = float(np.abs(load).max(initial=0.0))
        flank = load / np.hypot(load, _NO_LOAD * largest + 1e-12)
        return -(motion.gradient[:, :, joint] * flank)[:, :, None]


EFFECTS = (JointSpring(), CableStiffness(), EndStop(), JointFlexibility())
