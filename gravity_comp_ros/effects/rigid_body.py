"""
Rigid-body dynamics of an arm with one set of inertial parameters.

Inertial, centrifugal and Coriolis torque are linear in the inertial parameters of the links
(`models.kinematic.rigid_body`), among them the first moments of gravity. With known axes, a
nominal arm has these moments, and the other coefficients are deviations of its inertias. Without
a description, the serial arm fitted to gravity gives axes and moments, and the lengths between
its axes are coefficients too (`models.kinematic.unknown_lengths`). Rotors of geared drives add to
the inertia about their own joints alone.
"""

from __future__ import annotations

from gravity_comp_ros.data.samples import evenly_picked, FloatArray
from gravity_comp_ros.effects.arm_dynamics import (
    axis_sign_options, chain_dynamics, ChainDynamics, described_dynamics, Dynamics, NOMINAL,
    SIGN_SETTINGS)
from gravity_comp_ros.effects.effect import Coefficient, Coefficients, Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.effects.motion_fit import MotionProblem
from gravity_comp_ros.errors import ModelMismatchError
import numpy as np

# Minimum acceleration in rad/s^2 of a testable motion.
_MIN_ACCELERATION = 1e-3
# Number of poses at which the mass matrix is checked, and maximum size of negative eigenvalues
# relative to the largest.
_CHECKED, _NEGATIVE = 64, 0.05
# Number of samples, and factors of the prior standard deviation, that are compared.
_FITTED, _SHARES = 1500, (16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25, 0.1)
# Reduction of that maximum in this comparison: other effects change the fit later.
_MARGIN = 0.5


class RigidBodyDynamics(Effect):
    """The columns are those of the arm's `Dynamics`."""

    name = 'rigid_body_dynamics'
    title = 'Rigid-body dynamics'
    family = 'dynamics'
    equation = ('tau = Y0(q, qd, qdd, h) + sum_k Y_k(q, qd, qdd) I_k + J_n qdd_n, Y the regressor '
                'of a serial arm, h the first moments of gravity; Y0 = s Y p(h) with the nominal '
                'arm p(h) where a description gives the axes, else sum_i L_i(q, qd, qdd, h) l_i '
                'with the lengths l_i between axes')
    description = ('Inertial, centrifugal and Coriolis torque with one set of inertial parameters '
                   'for all joints, which includes the first moments of gravity. Without a robot '
                   'description the lengths between the axes are estimated as well.')
    coefficients = (NOMINAL, Coefficient('l_i', 'm', 'length between two axes'),
                    Coefficient('I_k', 'kg·m^2', 'moment or product of inertia'))
    confounders = ('inertia', 'coriolis')
    experiment = 'move several joints at once, at two speeds'
    signature = 'acceleration'
    source = ('M. Gautier, W. Khalil, IEEE Trans. Robotics and Automation 6, 1990; '
              'J. Wittenburg, Dynamics of Systems of Rigid Bodies, 1977')
    scope = 'arm'
    per_joint = False
    pointwise = True
    expectation = Expectation.MOTION
    setting_units = {'spread': '', **dict.fromkeys(SIGN_SETTINGS, '')}
    not_scanned = ('spread', *SIGN_SETTINGS)
    certain = True
    needs_speed = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        key = f'rigid_body {_signs(setting)}'
        if key not in motion.memo:
            samples = motion.samples
            dynamics = _required_dynamics(motion, setting)
            motion.memo[key] = dynamics.columns(samples.q, samples.qd, motion.qdd)
        return motion.memo[key]

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        dynamics = _dynamics(motion, setting)
        return self.coefficients[:1] if dynamics is None else dynamics.coefficients()

    def settings(self, motion: Motion, joint: int) -> list[dict[str, float]]:
        """Return the factor of the prior of unknown lengths, and the signs of vertical axes."""
        dynamics = _dynamics(motion, {})
        return [_best_setting(motion, dynamics)] if isinstance(dynamics, ChainDynamics) else [{}]

    def spread(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        prior_std = _required_dynamics(motion, setting).prior_std
        return np.where(np.isinf(prior_std), prior_std, setting.get('spread', 1.0) * prior_std)

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if _dynamics(motion, {}) is None:
            return ('the axes of the arm are unknown: there is no robot description, and no '
                    'serial arm fits the torque')
        largest = float(np.abs(motion.qdd).max(initial=0.0))
        if largest < _MIN_ACCELERATION:
            return f'the arm hardly accelerates (at most {largest:.2g} rad/s^2)'
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        return (_not_positive(_required_dynamics(motion, setting), values, motion.samples.q)
                or super().implausible(values, setting, motion, joint))


def _dynamics(motion: Motion, setting: Setting) -> Dynamics | None:
    """Return the dynamics of a motion's gravity model, or of its serial arm."""
    described = None if motion.model is None else described_dynamics(motion.model)
    if described is not None or motion.serial_arm is None:
        return described
    return chain_dynamics(motion.serial_arm, _signs(setting))


def _signs(setting: Setting) -> tuple[float, ...]:
    return tuple(setting[name] for name in SIGN_SETTINGS if name in setting)


def _required_dynamics(motion: Motion, setting: Setting) -> Dynamics:
    dynamics = _dynamics(motion, setting)
    if dynamics is None:
        raise ModelMismatchError(
            'the model has rigid-body dynamics, but neither a serial arm nor a robot description. '
            'Remove the effect and add it again')
    return dynamics


def _best_setting(motion: Motion, arm: ChainDynamics) -> dict[str, float]:
    """
    Return the setting with the smallest cross-validation error.

    The factor of the prior is reduced if the fitted mass matrix is not positive definite: few
    motions determine all lengths and inertias, and the nominal arm is physical. Then the signs of
    vertical axes are compared.
    """
    part = motion.at(evenly_picked(motion.samples.n_samples, _FITTED))
    q, chain = part.samples.q, arm.chain
    gravity = chain.jacobian(q).transpose(2, 1, 0)
    results = []
    for signs in axis_sign_options(chain, q):
        dynamics = chain_dynamics(chain, signs)
        problem = MotionProblem.of(gravity, 2 * q.shape[1], part, dynamics)
        results.append((*_best_share(problem, dynamics, q), signs))
    _, share, signs = min(results, key=lambda result: result[0])
    return {'spread': share, **dict(zip(SIGN_SETTINGS, signs))}


def _best_share(problem: MotionProblem, dynamics: ChainDynamics, q: FloatArray
                ) -> tuple[float, float]:
    """Return the cross-validation error and the best share, or a smaller physical one."""
    errors = problem.held_out_errors(_SHARES)
    for number in range(int(errors.argmin()), len(_SHARES)):
        coefficients = problem.fit(_SHARES[number]).dynamics
        lowest, highest = _eigenvalue_range(dynamics, coefficients, q)
        if lowest >= -_MARGIN * _NEGATIVE * highest:
            break
    return float(errors[number]), _SHARES[number]


def _not_positive(dynamics: Dynamics, values: FloatArray, q: FloatArray) -> str | None:
    """Return the reason if the mass matrix is not positive definite at poses of q (M, N)."""
    lowest, highest = _eigenvalue_range(dynamics, values, q)
    if lowest < -_NEGATIVE * highest:
        return (f'the mass matrix has a negative eigenvalue ({lowest:.2g} kg·m^2), and kinetic '
                f'energy is positive')
    return None


def _eigenvalue_range(dynamics: Dynamics, values: FloatArray,
                      q: FloatArray) -> tuple[float, float]:
    """Return the smallest and the largest eigenvalue of the mass matrix at poses of q (M, N)."""
    n = q.shape[1]
    few = q[np.linspace(0, len(q) - 1, _CHECKED).astype(int)] if len(q) else q
    rows = np.repeat(few, n, axis=0)
    columns = dynamics.columns(rows, 0.0 * rows, np.tile(np.eye(n), (len(few), 1)))
    masses = np.linalg.eigvalsh((columns @ np.asarray(values)).reshape(-1, n, n))
    return float(masses.min(initial=np.inf)), float(masses.max(initial=0.0))


EFFECTS = (RigidBodyDynamics(),)
