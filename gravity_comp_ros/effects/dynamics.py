"""What a moving arm needs beyond gravity: torque for acceleration and for turning frames."""

from __future__ import annotations

from itertools import product

from gravity_comp_ros.data.runs import recorded_time
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Coefficient, Coefficients, Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

_LEAST_ACCELERATION = 1e-3
_LEAST_SPEED_SQUARED = 1e-3
# So much motion tells one coupling, s.
_SECONDS_EACH = 10.0
# Joints as far apart as this couple by way of the angles between them.
_NEAR = 2
# The joint that accelerates, and the angles whose sines and cosines its torque is multiplied by.
_Coupling = tuple[int, tuple[tuple[int, np.ufunc], ...]]
_INERTIA = Coefficient('J', 'kg·m^2', 'moment of inertia about the joint, rotor included, in the '
                                      'middle of the motion')


class Inertia(Effect):
    """The columns are the joint's own acceleration, and after it what `_couplings` names."""

    name = 'inertia'
    title = 'Inertia'
    family = 'dynamics'
    equation = ('tau_n = J qdd_n; or, coupled, J qdd_n + sum_j m_j qdd_j, m_j constant or a sum '
                'over the sines and cosines of the angles between joints n and j')
    description = ('The torque that accelerates the arm and the rotor behind its gear; where the '
                   'motion shows it, also the part of the other joints, and how it changes with '
                   'the pose.')
    coefficients = (_INERTIA, Coefficient('m_j', 'kg·m^2', 'torque per acceleration of joint j, '
                                                           'and per factor of angles'))
    confounders = ('joint_spring', 'coriolis', 'rigid_body_dynamics')
    experiment = ('move joint {joint} to and fro over the same short way at two speeds; inertia '
                  'grows with the square of the speed')
    signature = 'acceleration'
    source = 'Yu 2022, Eq. (1); J. J. Craig, Introduction to Robotics, ch. 6'
    setting_units = {'coupled': '', 'mean_s': '', 'mean_c': ''}
    not_scanned = ('coupled', 'mean_s', 'mean_c')
    pointwise = True
    expectation = Expectation.MOTION
    needs_speed = True
    why_not_negative = 'a mass resists acceleration'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        parts = [motion.qdd[:, joint]]
        for other, turned in _couplings(motion.qdd.shape[1], joint, setting):
            factor = _factor(motion, turned)
            if other == joint:
                # The first coefficient is then the inertia in the middle of the motion.
                factor = factor - setting.get(_mean_of(turned), 0.0)
            parts.append(motion.qdd[:, other] * factor)
        return np.stack(parts, axis=1)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return own inertia, a row of the mass matrix, and one that turns with poses."""
        n, seconds = motion.qdd.shape[1], recorded_time(motion.samples)
        found: list[dict[str, float]] = [{'coupled': float(k)} for k in range(3)]
        weights = motion.qdd[:, joint] ** 2
        for other, turned in _couplings(n, joint, found[2]):
            if other == joint:
                found[2][_mean_of(turned)] = float(
                    weights @ _factor(motion, turned) / max(float(weights.sum()), 1e-300))
        counts = [1 + len(_couplings(n, joint, setting)) for setting in found]
        return [setting for setting, count, fewer in zip(found, counts, [0, *counts])
                if count == 1 or (count > fewer and seconds >= _SECONDS_EACH * count)]

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        found = [_INERTIA]
        for other, turned in _couplings(motion.qdd.shape[1], joint, setting):
            factors = ' '.join(f'{"s" if wave is np.sin else "c"}{k + 1}' for k, wave in turned)
            found.append(Coefficient(
                f'm_{other + 1}' + (f'[{factors}]' if factors else ''), 'kg·m^2',
                f'torque per acceleration of joint number {other + 1}'
                + (f', times {factors}' if factors else '')))
        return tuple(found)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        largest = float(np.abs(motion.qdd[:, joint]).max(initial=0.0))
        if largest < _LEAST_ACCELERATION:
            return f'the joint hardly accelerates (at most {largest:.2g} rad/s^2)'
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        # The joint's own inertia alone: a coupling has either sign.
        return super().implausible(values[:1], {}, motion, joint)


def _factor(motion: Motion, turned: tuple[tuple[int, np.ufunc], ...]) -> FloatArray:
    """Return the product (M,) of sines and cosines of angles."""
    factor = np.ones(motion.samples.n_samples)
    for place, wave in turned:
        factor = factor * wave(motion.samples.q[:, place])
    return factor


def _mean_of(turned: tuple[tuple[int, np.ufunc], ...]) -> str:
    """Return the name of the parameter that is the mean of a factor."""
    return 'mean_' + ''.join('s' if wave is np.sin else 'c' for _, wave in turned)


def _couplings(n_joints: int, joint: int, setting: Setting) -> list[_Coupling]:
    """
    Return what else a row of the mass matrix has: (joint that accelerates, factors of angles).

    Two joints couple by way of the angles between them, and a joint's own inertia hangs on the
    next angle. Joints farther apart than two are given one mean value: what their many angles
    do would take more numbers than a recording tells.
    """
    reach = setting.get('coupled', 0.0)
    if not reach:
        return []
    found: list[_Coupling] = []
    for other in range(n_joints):
        near, far = min(joint, other), max(joint, other)
        between = range(near + 1, far + 1) if other != joint else range(joint + 1, joint + 2)
        angles = [k for k in between if k < n_joints]
        if reach < 2.0 or far - near > _NEAR:
            angles = []
        for waves in product((None, np.sin, np.cos), repeat=len(angles)):
            turned = tuple((k, wave) for k, wave in zip(angles, waves) if wave is not None)
            if turned or other != joint:
                found.append((other, turned))
    return found


class Coriolis(Effect):
    name = 'coriolis'
    title = 'Centrifugal and Coriolis torque'
    family = 'dynamics'
    equation = 'tau_n = sum_jk h_jk qd_j qd_k over the joint and its neighbours, without qd_n^2'
    description = ('The torque that comes with products of speeds; constants stand for mean '
                   'values over the poses, so that it holds in a narrow range only.')
    coefficients = (Coefficient('h_j_k', 'kg·m^2', 'torque per product of two speeds'),)
    confounders = ('inertia', 'rigid_body_dynamics')
    experiment = ('move joint {joint} and its neighbours together at two speeds; this torque '
                  'grows with the square of the speed and does not turn with direction')
    signature = 'speed'
    source = 'Yu 2022, Eq. (1); J. J. Craig, Introduction to Robotics, ch. 6'
    pointwise = True
    expectation = Expectation.MOTION
    needs_speed = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        qd = motion.samples.qd
        pairs = _speed_products(qd.shape[1], joint)
        # An arm of one joint has no such torque; its column is empty.
        return np.stack([qd[:, a] * qd[:, b] for a, b in pairs] or [np.zeros(len(qd))], axis=1)

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        pairs = _speed_products(motion.samples.n_joints, joint)
        if not pairs:
            return (Coefficient('h', 'kg·m^2', 'none: the arm has one joint'),)
        return tuple(_speed_coefficient(a, b) for a, b in pairs)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.samples.n_joints < 2:
            return 'an arm of one joint has no such torque'
        largest = float(np.abs(self.columns(motion, joint, {})).max(initial=0.0))
        if largest < _LEAST_SPEED_SQUARED:
            return (f'products of speeds stay below {_LEAST_SPEED_SQUARED:g} (rad/s)^2, too slow '
                    f'for this torque to show')
        return None


def _speed_products(n_joints: int, joint: int) -> list[tuple[int, int]]:
    """
    Return the pairs of joints whose speeds' product may act on a joint.

    All pairs of the joint and its neighbours except its own square: M_nn does not depend on
    q_n, so that no such term exists.
    """
    near = [j for j in (joint - 1, joint, joint + 1) if 0 <= j < n_joints]
    return [(a, b) for k, a in enumerate(near) for b in near[k:] if not a == b == joint]


def _speed_coefficient(a: int, b: int) -> Coefficient:
    meaning = (f'torque per squared speed of joint number {a + 1}' if a == b else
               f'torque per product of the speeds of joints number {a + 1} and {b + 1}')
    return Coefficient(f'h_{a + 1}_{b + 1}', 'kg·m^2', meaning)


EFFECTS = (Inertia(), Coriolis())
