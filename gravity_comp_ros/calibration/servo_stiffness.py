"""
Stiffness of position-controlled joints, from goals and measured positions.

A servo without an integral part stops where its torque k (goal - q) balances the arm, so that

    goal - q = tau(q) / k + offset + friction / k + delay qd.

tau is the static torque of the model, with the springs and offsets that it found. 1 / k is fitted
by least squares with an offset of the position, friction by direction, and a delay between goal
and position, which includes viscous friction. tau and k have the unit of the effort of the
recordings to which the model was fitted: the position offset tau / k is correct in any unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gravity_comp_ros.calibration.known_weight import CalibrationOptions
from gravity_comp_ros.data.constants import HALF_95
from gravity_comp_ros.data.runs import per_error
from gravity_comp_ros.data.samples import FloatArray, JointSamples
from gravity_comp_ros.effects.motion_direction import directions
from gravity_comp_ros.effects.predict import static_torque
from gravity_comp_ros.errors import DataError
from gravity_comp_ros.facts.friction import without
from gravity_comp_ros.facts.options import FactOptions
from gravity_comp_ros.models.applied_effects import Quantity
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.regression.options import EngineOptions
import numpy as np


@dataclass(frozen=True, eq=False)
class ServoStiffness:
    """
    The result by joint: `stiffness` in N·m/rad, and why other joints are `left_out`.

    `sag` (rad RMS) is the part of goal - position that follows the torque, `rmse` (rad) the rest.
    """

    stiffness: Mapping[str, Quantity]
    left_out: Mapping[str, str]
    sag: Mapping[str, float]
    rmse: Mapping[str, float]


def servo_stiffness(model: GravityModel, samples: JointSamples, goal: FloatArray,
                    options: CalibrationOptions = CalibrationOptions()) -> ServoStiffness:
    """
    Return the stiffness of the servo of each joint.

    :param samples: slow motion; joints are matched by name.
    :param goal: goals (M, N) in rad at these samples, in the order of the model's joints; rows
        that are not finite are not used.
    :raises ModelMismatchError: if a joint of the model is not among the samples.
    :raises DataError: if there are too few samples, or no joint sags by its torque.
    """
    samples = samples.joints(model.joints)
    if goal.shape != samples.q.shape:
        raise DataError(f'stiffness: goals of shape {goal.shape} for {samples.q.shape} samples')
    known = np.isfinite(goal).all(axis=1)
    if known.sum() < FactOptions().min_slow_samples:
        raise DataError(f'{known.sum()} slow samples have a goal of every joint; at least '
                        f'{FactOptions().min_slow_samples} are needed')
    samples, goal = samples.select(known), goal[known]
    torque = static_torque(model, samples)
    of_error = per_error(samples.t, samples.runs, EngineOptions().block_seconds)
    stiffness, left_out, sag, rmse = {}, {}, {}, {}
    for j, joint in enumerate(model.joints):
        others = np.column_stack([np.ones(len(goal)), samples.qd[:, j],
                                  directions(samples, j)])
        # Without the part that the other columns explain, a torque of any size has its own error.
        load, error = (without(others, values) for values in (
            torque[:, j], goal[:, j] - samples.q[:, j]))
        size = max(float(np.linalg.norm(load)), 1e-12)
        slope = float(load @ error) / size ** 2
        rest = float((error - slope * load).std())
        std, sag[joint] = max(rest, 1e-9) * float(np.sqrt(of_error)) / size, float(
            torque[:, j].std() * abs(slope))
        if abs(slope) < options.significance * std:
            left_out[joint] = ('goal minus position does not follow the torque: its controller '
                               'has an integral part, or its torque hardly changes')
        elif slope < 0.0:
            left_out[joint] = ('the joint rises above its goal under load: the signs of goal and '
                               'effort differ, or an offset was in the goal')
        else:
            stiffness[joint] = Quantity.around(1.0 / slope, 'N·m/rad', HALF_95 * std / slope ** 2)
            rmse[joint] = rest
    if not stiffness:
        raise DataError('no stiffness: ' + '; '.join(
            f'{", ".join(joint for joint in left_out if left_out[joint] == why)}: {why}'
            for why in dict.fromkeys(left_out.values())))
    return ServoStiffness(stiffness, left_out, sag, rmse)


def held_goals(t: FloatArray, goal_t: FloatArray, goal: FloatArray) -> FloatArray:
    """
    Return the goal (M, N) in force at times t (M,), NaN before the first one.

    :param goal_t: rising times (G,) at which the goals (G, N) were sent; a goal is kept until the
        next one.
    """
    which = np.searchsorted(goal_t, t, side='right') - 1
    return np.where((which >= 0)[:, None], goal[np.maximum(which, 0)], np.nan)
