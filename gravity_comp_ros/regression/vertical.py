"""
Start of the vertical of an arm with known axes: mounted on a wall, an incline or a ceiling.

A robot description is usually upright, whatever the mounting of the real arm. The base tilts from
several verticals of half of the sphere to the most probable one near each (`arm_solver`). The
other half has the same torques with negated moments: there the masses of a nominal arm decide,
which are not negative.
"""

from __future__ import annotations

from dataclasses import replace

from gravity_comp_ros.data.constants import STANDARD_GRAVITY
from gravity_comp_ros.data.samples import FloatArray
from gravity_comp_ros.models.kinematic.arm_solver import ArmProblem, ArmSolver, ArmState
from gravity_comp_ros.models.kinematic.chain import aligned, tilt
from gravity_comp_ros.models.kinematic.geometry import Geometry
from gravity_comp_ros.models.kinematic.nominal_arm import unreachable_share
from gravity_comp_ros.regression.problem import Problem
from gravity_comp_ros.regression.start import arm_problem, generic_poses
import numpy as np

# Number of poses.
_POSES = 150
# Angles in rad from the described vertical to those from which the search begins, and their number
# around it.
_ANGLES, _AROUND = (0.0, np.radians(45.0), np.radians(90.0)), 4
# Largest base tilt, in rad, that the fit of the moments corrects without this search.
MAX_FITTED_TILT = np.radians(20.0)
# Log-likelihood ratio in nats, over the autocorrelation time, that another vertical must exceed:
# an unmodelled effect is partly collinear with a rotation of the base as well.
_MIN_GAIN = 12.0
# The arm is mounted upside down if that lowers the share of moments that non-negative masses do
# not reach below this multiple. The share of three real arms is 1 to 8 %, and 72 to 99 % when
# inverted; of randomly drawn arms 10 to 30 % and 30 to 80 %, so that some of these on a ceiling
# are not recognised.
_INVERTED = 0.7
# Error of the moments of a nominal arm, as a share of the largest torque.
_NOMINAL_ERROR = 0.05


def with_estimated_vertical(geometry: Geometry, problem: Problem) -> Geometry:
    """
    Return the geometry with the estimated vertical, unchanged if the described one is close.

    :param geometry: the axes of the samples' joints, in their order.
    """
    n = geometry.n_joints
    if n < 2:
        return geometry
    poses, nuisance = generic_poses(problem, _POSES)
    torques = arm_problem(poses, nuisance)
    at_rest = ArmSolver(torques, np.zeros(2 * n, dtype=bool))
    moving = replace(at_rest, shares=np.ones((len(poses), 1)))
    near, far = (at_rest.run(geometry.rotations), geometry.rotations), None
    for start in _starts(geometry.rotations):
        state = moving.run(start)
        axes = start.copy()
        axes[0] = tilt(state.base_tilts)[0] @ start[0]
        if base_tilt_angle(geometry.rotations, axes) > MAX_FITTED_TILT:
            far = min(far or (state, axes), (state, axes), key=lambda each: each[0].cost)
        else:
            near = min(near, (state, axes), key=lambda each: each[0].cost)
    is_far = far is not None and near[0].cost - far[0].cost > _MIN_GAIN * float(
        far[0].times(poses.runs).max())
    axes = far[1] if far is not None and is_far else near[1]
    rotated = replace(geometry, rotations=axes)
    state = at_rest.run(axes)
    inverted = _inverted(rotated, state, _identified(torques, at_rest, state))
    return inverted or (rotated if is_far else geometry)


def base_tilt_angle(rotations: FloatArray, others: FloatArray) -> float:
    """Return the angle in rad between the verticals of two arms, from their axes (N, 3, 3)."""
    one, other = rotations[0][2], others[0][2]
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other))


def _starts(rotations: FloatArray) -> list[FloatArray]:
    """Return the axes (N, 3, 3) with the verticals of the starts, the described one first."""
    starts = []
    for angle in _ANGLES:
        for k in range(_AROUND if angle else 1):
            about = 2.0 * np.pi * k / _AROUND
            vertical = np.array([np.sin(angle) * np.cos(about), np.sin(angle) * np.sin(about),
                                 np.cos(angle)])
            start = rotations.copy()
            start[0] = aligned(vertical).T @ rotations[0]
            starts.append(start)
    return starts


def _inverted(geometry: Geometry, state: ArmState, weights: FloatArray) -> Geometry | None:
    """Return the geometry upside down, None if non-negative masses reach its moments as it is."""
    rotations, moments = geometry.rotations.copy(), state.chain.moments / STANDARD_GRAVITY
    rotations[0] = np.diag([1.0, -1.0, -1.0]) @ rotations[0]
    inverted = replace(geometry, rotations=rotations)
    is_inverted = (unreachable_share(inverted, -moments, weights)
                   < _INVERTED * unreachable_share(geometry, moments, weights))
    return inverted if is_inverted else None


def _identified(torques: ArmProblem, solver: ArmSolver, state: ArmState) -> FloatArray:
    """
    Return weights (2 N, 2 N) of the moments.

    They are 1 for moments that the motion identifies better than a nominal arm can reproduce
    them, and 0 for those that it does not excite.
    """
    values, vectors = np.linalg.eigh(solver.precision(state))
    largest = float(np.abs(torques.tau).max())
    values = np.maximum(values, 0.0) * (largest * _NOMINAL_ERROR) ** 2
    return np.asarray((vectors * np.sqrt(values / (1.0 + values))) @ vectors.T)
