"""What a moving arm needs beyond gravity: torque for acceleration and for turning frames."""

from __future__ import annotations

from gravity_comp_ros.effects.effect import Coefficient, Effect, Motion, Setting
from gravity_comp_ros.effects.plausible import not_negative, within_torque
from gravity_comp_ros.samples import FloatArray
import numpy as np

_LEAST_ACCELERATION = 1e-3
_LEAST_SPEED_SQUARED = 1e-3


def _inertia(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    return motion.qdd[:, [joint]]


def _inertia_untestable(motion: Motion, joint: int) -> str | None:
    largest = float(np.abs(motion.qdd[:, joint]).max(initial=0.0))
    if largest < _LEAST_ACCELERATION:
        return f'the joint hardly accelerates (at most {largest:.2g} rad/s^2)'
    return None


def speed_products(n_joints: int, joint: int) -> list[tuple[int, int]]:
    """
    Return the pairs of joints whose speeds' product may act on a joint.

    All pairs of the joint and its neighbours except its own square: M_nn does not depend on
    q_n, so that no such term exists.
    """
    near = [j for j in (joint - 1, joint, joint + 1) if 0 <= j < n_joints]
    return [(a, b) for k, a in enumerate(near) for b in near[k:] if not a == b == joint]


def _coriolis(motion: Motion, joint: int, setting: Setting) -> FloatArray:
    qd = motion.samples.qd
    pairs = speed_products(qd.shape[1], joint)
    # An arm of one joint has no such torque; its column is empty.
    return np.stack([qd[:, a] * qd[:, b] for a, b in pairs] or [np.zeros(len(qd))], axis=1)


def _coriolis_symbols(motion: Motion, joint: int, setting: Setting) -> tuple[Coefficient, ...]:
    pairs = speed_products(motion.samples.n_joints, joint)
    if not pairs:
        return (Coefficient('h', 'kg·m^2', 'none: the arm has one joint'),)
    return tuple(_speed_coefficient(a, b) for a, b in pairs)


def _speed_coefficient(a: int, b: int) -> Coefficient:
    meaning = (f'torque per squared speed of joint number {a + 1}' if a == b else
               f'torque per product of the speeds of joints number {a + 1} and {b + 1}')
    return Coefficient(f'h_{a + 1}_{b + 1}', 'kg·m^2', meaning)


def _coriolis_untestable(motion: Motion, joint: int) -> str | None:
    if motion.samples.n_joints < 2:
        return 'an arm of one joint has no such torque'
    largest = float(np.abs(_coriolis(motion, joint, {})).max(initial=0.0))
    if largest < _LEAST_SPEED_SQUARED:
        return (f'products of speeds stay below {_LEAST_SPEED_SQUARED:g} (rad/s)^2, too slow '
                f'for this torque to show')
    return None


EFFECTS = (
    Effect(
        name='inertia',
        title='Inertia',
        family='dynamics',
        equation='tau_n = J qdd_n',
        description='The torque that accelerates the arm and the rotor behind its gear; one '
                    'mean value over the poses of the recording.',
        coefficients=(Coefficient('J', 'kg·m^2', 'moment of inertia about the joint, rotor '
                                                 'included'),),
        columns=_inertia,
        confounders=('joint_spring', 'coriolis'),
        experiment='move joint {joint} to and fro over the same short way at two speeds; '
                   'inertia grows with the square of the speed',
        signature='acceleration',
        source='Yu 2022, Eq. (1); J. J. Craig, Introduction to Robotics, ch. 6',
        untestable=_inertia_untestable,
        implausible=not_negative(_inertia, 'a mass resists acceleration')),
    Effect(
        name='coriolis',
        title='Centrifugal and Coriolis torque',
        family='dynamics',
        equation='tau_n = sum_jk h_jk qd_j qd_k over the joint and its neighbours, without '
                 'qd_n^2',
        description='The torque that comes with products of speeds; constants stand for mean '
                    'values over the poses, so that it holds in a narrow range only.',
        coefficients=(Coefficient('h_j_k', 'kg·m^2', 'torque per product of two speeds'),),
        columns=_coriolis,
        confounders=('inertia',),
        experiment='move joint {joint} and its neighbours together at two speeds; this torque '
                   'grows with the square of the speed and does not turn with direction',
        signature='speed',
        source='Yu 2022, Eq. (1); J. J. Craig, Introduction to Robotics, ch. 6',
        symbols=_coriolis_symbols,
        untestable=_coriolis_untestable,
        implausible=within_torque(_coriolis)),
)
