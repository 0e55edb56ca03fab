"""
The torque of motion of an arm whose axes are known, from one set of inertial parameters.

With the axes known, mass matrix, centrifugal and Coriolis torque are linear in the inertial
parameters of the links (`models.kinematic.rigid_body`). The first moments among them are those of
gravity. So there is a nominal arm: masses along the links that have these first moments. Its
torque of motion is one column, whose coefficient is about 1. How the inertias of the real arm
differ is in the others, with a prior: most motions do not show all of them, and what a motion
does not show is that of the nominal arm. Rotors behind their gears add to the inertia about their
own joints alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray, IntArray
from gravity_comp_ros.effects.effect import Coefficient, Coefficients, Effect, Expectation, Setting
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.models.kinematic.chain import ForwardKinematics
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import mean_inertia, nominal_parameters
from gravity_comp_ros.models.kinematic.rigid_body import identifiable, PARAMETERS, regressor
import numpy as np

# rad/s^2: below, the torque of motion hides in the noise.
_LEAST_ACCELERATION = 1e-3
# Samples whose regressor is built at once, and poses at which moments are read off a model.
_AT_ONCE, _POSES = 4096, 256
# Poses at which the mass matrix is checked, and how negative its eigenvalues may be, relative to
# the largest.
_CHECKED, _NEGATIVE = 64, 0.05
# How far inertias differ from those of the nominal arm, relative to what its joint carries; how
# large a rotor is, and what every joint carries at least, relative to the joint that carries most.
_DIFFERS, _ROTOR, _LEAST = 0.2, 0.02, 0.01
_NOMINAL = Coefficient('s', '', 'share of the torque of motion of the nominal arm, whose first '
                                'moments are those of gravity')


@dataclass(frozen=True, eq=False)
class Dynamics:
    """
    What the columns are made of: axes, nominal parameters (10 N,), inertias and rotors.

    `inertias` (K,) are parameter numbers, `rotors` (R,) joint numbers; `usual` (1 + K + R,) is how
    large the coefficients are before any data.
    """

    geometry: Geometry
    nominal: FloatArray
    inertias: IntArray
    rotors: IntArray
    usual: FloatArray


@lru_cache(maxsize=4)
def dynamics_of(model: GravityModel) -> Dynamics:
    """
    Return what the columns of a gravity model on known axes are made of.

    :raises DataError: if the model has no geometry.
    """
    geometry = model.geometry
    if geometry is None:
        raise DataError('the axes of the arm are unknown')
    inertias, rotors = identifiable(geometry)
    nominal = nominal_parameters(geometry, first_moments(model, geometry))
    carried = mean_inertia(geometry, nominal)
    carried = np.maximum(carried, max(_LEAST * float(carried.max()), 1e-6))
    usual = np.concatenate([[np.inf], _DIFFERS * carried[inertias // 10],
                            np.full(len(rotors), _ROTOR * carried.max())])
    return Dynamics(geometry, nominal, inertias, rotors, usual)


def first_moments(model: GravityModel, geometry: Geometry) -> FloatArray:
    """
    Return the first moments (N, 2) of a gravity model about known axes, in kg·m.

    They are those of its chain, or what comes nearest to its torque over the trained range.
    """
    chain = model.chain
    if chain is not None and np.allclose(chain.axes[1:], geometry.rotations[1:], atol=1e-6):
        return chain.moments / STANDARD_GRAVITY
    low, high = model.coverage.q_min, model.coverage.q_max
    q = np.random.default_rng(0).uniform(low, np.maximum(high, low), (_POSES, model.n_joints))
    columns = ForwardKinematics(geometry.rotations, q).moment_columns()
    flat = columns.reshape(len(columns), -1).T
    found = np.linalg.lstsq(flat, model.predict(q).T.ravel(), rcond=1e-6)[0]
    return np.asarray(found.reshape(-1, 2) / STANDARD_GRAVITY)


def columns_of(dynamics: Dynamics, q: FloatArray, qd: FloatArray,
               qdd: FloatArray) -> FloatArray:
    """Return the columns (M, N, 1 + K + R) for angles, speeds and accelerations (M, N)."""
    k = 1 + len(dynamics.inertias)
    found = np.zeros((*q.shape, k + len(dynamics.rotors)))
    for start in range(0, len(q), _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        every = regressor(dynamics.geometry, q[rows], qd[rows], qdd[rows])
        found[rows, :, 0] = every @ dynamics.nominal
        found[rows, :, 1:k] = every[:, :, dynamics.inertias]
    for place, joint in enumerate(dynamics.rotors):
        found[:, joint, k + place] = qdd[:, joint]
    return found


class RigidBodyDynamics(Effect):
    """The columns are the torque of the nominal arm, of inertias and of rotors."""

    name = 'rigid_body_dynamics'
    title = 'Rigid-body dynamics'
    family = 'dynamics'
    equation = ('tau = s Y(q, qd, qdd) p(h) + sum_k Y_k(q, qd, qdd) I_k + J_n qdd_n, Y the '
                'regressor of a serial arm with known axes, p(h) the nominal arm with the first '
                'moments h of gravity')
    description = ('The torque that accelerates the links, with centrifugal and Coriolis torque: '
                   'one set of inertial parameters for all joints, the first moments shared with '
                   'gravity. It needs a description of the robot.')
    coefficients = (_NOMINAL, Coefficient('I_k', 'kg·m^2', 'moment or product of inertia'))
    confounders = ('inertia', 'coriolis')
    experiment = 'move several joints at once, at two speeds'
    signature = 'acceleration'
    source = ('M. Gautier, W. Khalil, IEEE Trans. Robotics and Automation 6, 1990; '
              'B. Siciliano, O. Khatib, Springer Handbook of Robotics, ch. 6')
    scope = 'arm'
    per_joint = False
    pointwise = True
    expectation = Expectation.MOTION
    certain = True
    needs_speed = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        if 'rigid_body' not in motion.memo:
            samples = motion.samples
            motion.memo['rigid_body'] = columns_of(_dynamics(motion), samples.q, samples.qd,
                                                   motion.qdd)
        return motion.memo['rigid_body']

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        if motion.model is None or motion.model.geometry is None:
            return (_NOMINAL,)
        dynamics = _dynamics(motion)
        return (_NOMINAL, *(_inertia(int(k)) for k in dynamics.inertias),
                *(Coefficient(f'J_{n + 1}', 'kg·m^2',
                              f'inertia of the rotor of joint number {n + 1}, behind its gear')
                  for n in dynamics.rotors))

    def spread(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return _dynamics(motion).usual

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.model is None or motion.model.geometry is None:
            return ('where the axes of the arm are is unknown: fit the model with a description '
                    'of the robot')
        largest = float(np.abs(motion.qdd).max(initial=0.0))
        if largest < _LEAST_ACCELERATION:
            return f'the arm hardly accelerates (at most {largest:.2g} rad/s^2)'
        return None

    def implausible(self, values: FloatArray, setting: Setting, motion: Motion,
                    joint: int) -> str | None:
        return (_not_positive(_dynamics(motion), values, motion.samples.q)
                or super().implausible(values, setting, motion, joint))


def _dynamics(motion: Motion) -> Dynamics:
    assert motion.model is not None
    return dynamics_of(motion.model)


def _inertia(parameter: int) -> Coefficient:
    link, kind = parameter // 10 + 1, PARAMETERS[parameter % 10]
    return Coefficient(f'{kind}_{link}', 'kg·m^2', f'{kind} of link number {link} beyond that of '
                                                   f'the nominal arm, what it carries included')


def _not_positive(dynamics: Dynamics, values: FloatArray, q: FloatArray) -> str | None:
    """Check that kinetic energy is positive, at poses of q (M, N)."""
    n = q.shape[1]
    few = q[np.linspace(0, len(q) - 1, _CHECKED).astype(int)] if len(q) else q
    rows = np.repeat(few, n, axis=0)
    columns = columns_of(dynamics, rows, 0.0 * rows, np.tile(np.eye(n), (len(few), 1)))
    masses = np.linalg.eigvalsh((columns @ np.asarray(values)).reshape(-1, n, n))
    if len(few) and masses.min() < -_NEGATIVE * masses.max():
        return (f'the mass matrix has an eigenvalue of {masses.min():.2g} kg·m^2: kinetic energy '
                f'cannot be negative')
    return None


EFFECTS = (RigidBodyDynamics(),)
