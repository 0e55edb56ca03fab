"""Dynamic torque of single joints: inertia, centrifugal and Coriolis torque."""

from __future__ import annotations

from itertools import product

from gravity_comp_ros.data.runs import recorded_time
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import Coefficient, Coefficients, Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
import numpy as np

# Minimum acceleration, in rad/s^2, and product of speeds, in (rad/s)^2, of a testable motion.
_MIN_ACCELERATION = 1e-3
_MIN_SPEED_PRODUCT = 1e-3
# Duration of motion required for each coefficient, in s.
_SECONDS_PER_COEFFICIENT = 10.0
# Maximum distance, in joints, of a coupling that depends on the angles between two joints.
_NEAR = 2
# The accelerating joint, and the trigonometric factors of its column: (joint, sine or cosine).
_Coupling = tuple[int, tuple[tuple[int, np.ufunc], ...]]
_INERTIA = Coefficient('J', 'kg·m^2', 'moment of inertia about the joint, including the rotor, '
                                      'mean over the motion')


class Inertia(Effect):
    """The columns are the joint's own acceleration, then those of `_couplings`."""

    name = 'inertia'
    title = 'Inertia'
    family = 'dynamics'
    equation = ('tau_n = J qdd_n; or, coupled, J qdd_n + sum_j m_j qdd_j, m_j constant or a sum '
                'over the sines and cosines of the angles between joints n and j')
    description = ('Torque that accelerates the arm and the rotor of the drive. If the motion '
                   'excites them, it includes the coupling with other joints and its dependence '
                   'on the pose.')
    coefficients = (_INERTIA, Coefficient('m_j', 'kg·m^2', 'torque per acceleration of joint j '
                                                           'and trigonometric factor'))
    confounders = ('joint_spring', 'coriolis', 'rigid_body_dynamics')
    experiment = ('move joint {joint} back and forth over the same short range at two speeds; '
                  'inertial torque grows with the square of the speed')
    signature = 'acceleration'
    source = 'Yu 2022, Eq. (1); J. J. Craig, Introduction to Robotics, ch. 6'
    setting_units = {'coupled': '', 'mean_s': '', 'mean_c': ''}
    not_scanned = ('coupled', 'mean_s', 'mean_c')
    pointwise = True
    expectation = Expectation.MOTION
    needs_speed = True
    why_not_negative = 'a moment of inertia is positive'

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        parts = [motion.qdd[:, joint]]
        for other, waves in _couplings(motion.qdd.shape[1], joint, setting):
            factor = _factor(motion, waves)
            if other == joint:
                # Centred, so that the first coefficient is the mean inertia.
                factor = factor - setting.get(_mean_name(waves), 0.0)
            parts.append(motion.qdd[:, other] * factor)
        return np.stack(parts, axis=1)

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return own inertia, a constant row of the mass matrix, and one that varies with q."""
        n, seconds = motion.qdd.shape[1], recorded_time(motion.samples)
        forms: list[dict[str, float]] = [{'coupled': float(k)} for k in range(3)]
        weights = motion.qdd[:, joint] ** 2
        for other, waves in _couplings(n, joint, forms[2]):
            if other == joint:
                forms[2][_mean_name(waves)] = float(
                    weights @ _factor(motion, waves) / max(float(weights.sum()), 1e-300))
        counts = [1 + len(_couplings(n, joint, setting)) for setting in forms]
        return [setting for setting, count, fewer in zip(forms, counts, [0, *counts])
                if count == 1 or (count > fewer and seconds >= _SECONDS_PER_COEFFICIENT * count)]

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        coefficients = [_INERTIA]
        for other, waves in _couplings(motion.qdd.shape[1], joint, setting):
            factors = ' '.join(f'{"s" if wave is np.sin else "c"}{k + 1}' for k, wave in waves)
            coefficients.append(Coefficient(
                f'm_{other + 1}' + (f'[{factors}]' if factors else ''), 'kg·m^2',
                f'torque per acceleration of joint number {other + 1}'
                + (f', times {factors}' if factors else '')))
        return tuple(coefficients)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        largest = float(np.abs(motion.qdd[:, joint]).max(initial=0.0))
        if largest < _MIN_ACCELERATION:
            return f'the joint hardly accelerates (at most {largest:.2g} rad/s^2)'
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        # Only the joint's own inertia is checked: a coupling can have either sign.
        return super().implausible(values[:1], {}, motion, joint)


def _factor(motion: Motion, waves: tuple[tuple[int, np.ufunc], ...]) -> FloatArray:
    """Return the product (M,) of sines and cosines of angles."""
    factor = np.ones(motion.samples.n_samples)
    for number, wave in waves:
        factor = factor * wave(motion.samples.q[:, number])
    return factor


def _mean_name(waves: tuple[tuple[int, np.ufunc], ...]) -> str:
    """Return the name of the parameter with the mean of a factor."""
    return 'mean_' + ''.join('s' if wave is np.sin else 'c' for _, wave in waves)


def _couplings(n_joints: int, joint: int, setting: Setting) -> list[_Coupling]:
    """
    Return the further terms of a row of the mass matrix: (accelerating joint, factors).

    The coupling of two joints depends on the angles between them, and a joint's own inertia on
    the next angle. Couplings of more distant joints are constant, which limits the number of
    coefficients.
    """
    reach = setting.get('coupled', 0.0)
    if not reach:
        return []
    couplings: list[_Coupling] = []
    for other in range(n_joints):
        near, far = min(joint, other), max(joint, other)
        between = range(near + 1, far + 1) if other != joint else range(joint + 1, joint + 2)
        angles = [k for k in between if k < n_joints]
        if reach < 2.0 or far - near > _NEAR:
            angles = []
        for choice in product((None, np.sin, np.cos), repeat=len(angles)):
            waves = tuple((k, wave) for k, wave in zip(angles, choice) if wave is not None)
            if waves or other != joint:
                couplings.append((other, waves))
    return couplings


class Coriolis(Effect):
    name = 'coriolis'
    title = 'Centrifugal and Coriolis torque'
    family = 'dynamics'
    equation = 'tau_n = sum_jk h_jk qd_j qd_k over the joint and its neighbours, without qd_n^2'
    description = ('Torque proportional to products of joint speeds. The coefficients are mean '
                   'values over the poses, valid in a narrow range only.')
    coefficients = (Coefficient('h_j_k', 'kg·m^2', 'torque per product of two speeds'),)
    confounders = ('inertia', 'rigid_body_dynamics')
    experiment = ('move joint {joint} and its neighbours together at two speeds; this torque '
                  'grows with the square of the speed and does not reverse with the direction')
    signature = 'speed'
    source = 'Yu 2022, Eq. (1); J. J. Craig, Introduction to Robotics, ch. 6'
    pointwise = True
    expectation = Expectation.MOTION
    needs_speed = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        qd = motion.samples.qd
        pairs = _speed_products(qd.shape[1], joint)
        # An arm with one joint has no such torque; its column is zero.
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
        if largest < _MIN_SPEED_PRODUCT:
            return (f'products of speeds stay below {_MIN_SPEED_PRODUCT:g} (rad/s)^2, too low to '
                    f'identify this torque')
        return None


def _speed_products(n_joints: int, joint: int) -> list[tuple[int, int]]:
    """
    Return the pairs of joints whose product of speeds acts on a joint.

    They are all pairs of the joint and its neighbours except its own square: M_nn does not depend
    on q_n.
    """
    near = [j for j in (joint - 1, joint, joint + 1) if 0 <= j < n_joints]
    return [(a, b) for k, a in enumerate(near) for b in near[k:] if not a == b == joint]


def _speed_coefficient(a: int, b: int) -> Coefficient:
    meaning = (f'torque per squared speed of joint number {a + 1}' if a == b else
               f'torque per product of the speeds of joints number {a + 1} and {b + 1}')
    return Coefficient(f'h_{a + 1}_{b + 1}', 'kg·m^2', meaning)


EFFECTS = (Inertia(), Coriolis())
