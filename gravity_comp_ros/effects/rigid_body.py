"""
Rigid-body dynamics of an arm: inertial, centrifugal and Coriolis torque.

Every fit estimates it as a part of the shared columns (`regression.shared`), so that it is not
selected. Adding the effect makes the model predict it. On a robot description's axes the torque is
linear in the base parameters of the links (M. Gautier, W. Khalil, IEEE Transactions on Robotics
and Automation 6, 1990); without one in the lengths between the axes and the inertias of the links.
"""

from __future__ import annotations

from collections.abc import Iterator

from gravity_comp_ros.data.poses import batches
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import (
    Coefficient, Coefficients, Effect, Needs, Setting)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.kinematic.arm_columns import (
    ArmMotion, kept_parameters, motion_columns, motion_torque)
from gravity_comp_ros.models.kinematic.rigid_body import (
    inverse_dynamics, PARAMETERS, regressor)
import numpy as np

DYNAMICS = 'rigid_body_dynamics'
# Minimum acceleration in rad/s^2 of a testable motion.
_MIN_ACCELERATION = 1e-3


class RigidBodyDynamics(Effect):
    """The columns are those of motion of the arm's shared part."""

    name = DYNAMICS
    title = 'Rigid-body dynamics'
    family = 'dynamics'
    equation = ('tau = sum_k (Y_k(q, qd, qdd) - Y_k(q, 0, 0)) p_k with a robot description, else '
                'sum_i L_i(q, qd, qdd) l_i + sum_k Y_k(q, qd, qdd) I_k, with the axes and moments '
                'of gravity')
    description = ('Inertial, centrifugal and Coriolis torque with one set of inertial parameters '
                   'for all joints.')
    coefficients = (Coefficient('l_i', 'm', 'length between two axes'),
                    Coefficient('I_k', 'kg·m^2', 'moment or product of inertia'))
    confounders = ()
    experiment = 'move several joints at once, at two speeds'
    signature = 'acceleration'
    needs = Needs.ACCELERATION
    source = ('M. Gautier, W. Khalil, IEEE Trans. Robotics and Automation 6, 1990; '
              'J. Wittenburg, Dynamics of Systems of Rigid Bodies, 1977')
    scope = 'arm'
    per_joint = False
    is_common = True
    is_shared = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return np.concatenate([_columns(motion, *state) for state in _batches(motion)])

    def torque(self, motion: Motion, joint: int, setting: Setting,
               values: FloatArray) -> FloatArray:
        # All columns of a long recording together take gigabytes.
        return np.concatenate([_torque(motion, values, *state) for state in _batches(motion)])

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        n = motion.samples.n_joints
        if motion.geometry is not None:
            count = len(kept_parameters(motion.geometry))
            return tuple(Coefficient(f'p_{k + 1}', '', f'base parameter number {k + 1}')
                         for k in range(count))
        return (*(Coefficient(f'l_{i + 1}{axis}', 'm', f'length between joints number {i + 1} '
                                                       f'and {i + 2}')
                  for i in range(n - 1) for axis in 'xyz'),
                *(Coefficient(f'I_{i + 1}{pair}', 'kg·m^2', f'inertia of link number {i + 1}')
                  for i in range(n) for pair in ('xx', 'yy', 'zz', 'xy', 'xz', 'yz')))

    def untestable(self, motion: Motion, joint: int) -> str | None:
        if motion.geometry is None and motion.chain is None:
            return ('the axes of the arm are unknown: there is no robot description, and no '
                    'serial arm fits the torque')
        largest = float(np.abs(motion.qdd).max(initial=0.0))
        if largest < _MIN_ACCELERATION:
            return f'the arm hardly accelerates (at most {largest:.2g} rad/s^2)'
        return None


def _batches(motion: Motion) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield angles, speeds and accelerations (B, N) of consecutive samples."""
    samples = motion.samples
    for rows in batches(samples.n_samples):
        yield samples.q[rows], samples.qd[rows], motion.qdd[rows]


def _columns(motion: Motion, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """Return the columns (B, N, K)."""
    if motion.geometry is not None:
        return np.asarray(regressor(motion.geometry, q, qd, qdd)[
            :, :, kept_parameters(motion.geometry)])
    assert motion.chain is not None
    return motion_columns(ArmMotion.of(motion.chain, q, qd, qdd)).transpose(2, 0, 1)


def _torque(motion: Motion, values: FloatArray, q: FloatArray, qd: FloatArray,
            qdd: FloatArray) -> FloatArray:
    """Return the columns times coefficients (K,), (B, N)."""
    if motion.geometry is None:
        assert motion.chain is not None
        lengths, inertias = np.split(values, [3 * motion.chain.n_joints - 3])
        return motion_torque(ArmMotion.of(motion.chain, q, qd, qdd), lengths.reshape(-1, 3),
                             inertias.reshape(-1, 6))
    parameters = np.zeros(len(PARAMETERS) * motion.geometry.n_joints)
    parameters[kept_parameters(motion.geometry)] = values
    return inverse_dynamics(motion.geometry, q, qd, qdd, parameters)


EFFECTS = (RigidBodyDynamics(),)
