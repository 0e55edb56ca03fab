"""Gravity torque as feed-forward effort of a trajectory, for joint_trajectory_controller."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.models.gravity_model import GravityModel
import numpy as np


def fill_effort(trajectory: Any, model: GravityModel, margin: float = 0.2,
                max_torque: Sequence[float] = ()) -> None:
    """
    Write the model's torque into the effort of every point, N·m.

    The controller interpolates linearly between points, so points should be at most 0.1 rad
    apart. Joints of the trajectory that are not in the model get 0.

    :param trajectory: a `trajectory_msgs/JointTrajectory`; it is changed.
    :param margin: largest distance of a point outside the trained range, rad.
    :param max_torque: largest torque, one or one per joint of the model; empty for no limit.
    :raises ModelMismatchError: if a joint of the model is not in the trajectory.
    :raises DataError: if a point has no finite pose, is too far outside the trained range, or
        requires more torque than allowed. The trajectory is unchanged then.
    """
    names = list(trajectory.joint_names)
    missing = [name for name in model.joints if name not in names]
    if missing:
        raise ModelMismatchError(f'the trajectory lacks {", ".join(missing)} of the model; plan '
                                 'for all joints of the arm')
    place = [names.index(name) for name in model.joints]
    efforts: list[list[float]] = []
    for k, point in enumerate(trajectory.points):
        if len(point.positions) != len(names) or not np.isfinite(point.positions).all():
            raise DataError(f'point {k} of the trajectory has no finite position for each joint')
        q = np.asarray(point.positions, dtype=np.float64)[place]
        outside = model.extrapolation(q)
        if outside > margin:
            raise DataError(f'point {k} of the trajectory is {outside:.2f} rad outside the range '
                            'that the model was trained on; train the model there first')
        tau = model.predict_one(q)
        if len(max_torque) and (np.abs(tau) > np.asarray(max_torque)).any():
            raise DataError(f'point {k} of the trajectory requires {np.abs(tau).max():.1f} N·m, '
                            'more than allowed')
        effort = np.zeros(len(names))
        effort[place] = tau
        efforts.append(effort.tolist())
    for point, values in zip(trajectory.points, efforts):
        point.effort = values
