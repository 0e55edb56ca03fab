"""
Rigid-body dynamics of an arm: inertial, centrifugal and Coriolis torque.

Every fit estimates it as a part of the shared columns (`regression.shared`), so that it is not
selected. Adding the effect makes the model predict it. On a robot description's axes the torque is
linear in the base parameters of the links (M. Gautier, W. Khalil, IEEE Transactions on Robotics
and Automation 6, 1990); without one in the lengths between the axes and the inertias of the links.
"""

from __future__ import annotations

from collections.abc import Iterator

from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.effects.effect import (
    Coefficient, Coefficients, Effect, Expectation, Needs, Setting)
from gravity_comp_ros.effects.motion import Motion
from gravity_comp_ros.models.kinematic.arm_columns import described_columns, motion_columns
import numpy as np

DYNAMICS = 'rigid_body_dynamics'
_BATCH = 4096
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
    expectation = Expectation.COMMON
    is_shared = True

    def columns(self, motion: Motion, joint: int, setting: Setting) -> FloatArray:
        return np.concatenate(list(self._batches(motion)))

    def torque(self, motion: Motion, joint: int, setting: Setting,
               values: FloatArray) -> FloatArray:
        # All columns of a long recording together take gigabytes.
        return np.concatenate([columns @ values for columns in self._batches(motion)])

    @staticmethod
    def _batches(motion: Motion) -> Iterator[FloatArray]:
        """Yield the columns (B, N, K) of consecutive samples."""
        samples = motion.samples
        for start in range(0, max(samples.n_samples, 1), _BATCH):
            rows = slice(start, start + _BATCH)
            state = samples.q[rows], samples.qd[rows], motion.qdd[rows]
            if motion.geometry is not None:
                yield described_columns(motion.geometry, *state) - described_columns(
                    motion.geometry, state[0], 0.0 * state[0], 0.0 * state[0])
            else:
                assert motion.chain is not None
                yield motion_columns(motion.chain, *state)

    def coefficients_of(self, motion: Motion, joint: int, setting: Setting) -> Coefficients:
        n = motion.samples.n_joints
        if motion.geometry is not None:
            count = described_columns(motion.geometry, *np.zeros((3, 1, n))).shape[2]
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


EFFECTS = (RigidBodyDynamics(),)
