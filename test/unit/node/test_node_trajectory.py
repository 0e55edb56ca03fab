"""Gravity in the effort of a trajectory, by joint name and within the trained range."""

from gravity_comp_ros.errors import DataError, ModelMismatchError
from gravity_comp_ros.models.gravity_model import Coverage, GravityModel
from gravity_comp_ros.models.sparse.dictionary import Expansion
from gravity_comp_ros.node.trajectory import fill_effort
import numpy as np
import pytest
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


@pytest.fixture
def model():
    """Return tau = (8 sin q_a, 3 sin q_b), trained within ±1 rad."""
    torques = tuple(Expansion(np.array([k]), np.array([w])) for k, w in ((3, 8.0), (1, 3.0)))
    return GravityModel(('a', 'b'), 'per_joint', torques, None, np.full(2, 0.1),
                        Coverage(np.full(2, -1.0), np.full(2, 1.0), 100))


def trajectory(names, *poses):
    return JointTrajectory(joint_names=names, points=[
        JointTrajectoryPoint(positions=list(pose)) for pose in poses])


def test_each_point_gets_the_torque_of_its_pose_by_name(model):
    plan = trajectory(['b', 'gripper', 'a'], (0.5, 9.0, -0.3), (0.0, 9.0, 1.1))
    fill_effort(plan, model)
    np.testing.assert_allclose(plan.points[0].effort,
                               [3 * np.sin(0.5), 0.0, 8 * np.sin(-0.3)])
    np.testing.assert_allclose(plan.points[1].effort, [0.0, 0.0, 8 * np.sin(1.1)])


@pytest.mark.parametrize('names, poses, options, error, message', [
    (['a', 'c'], [(0.0, 0.0)], {}, ModelMismatchError, 'lacks b'),
    (['a', 'b'], [(0.0, 0.0), (0.0, 1.3)], {}, DataError, 'point 1 .* 0.30 rad outside'),
    (['a', 'b'], [(0.0, 0.0), (0.0,)], {}, DataError, 'no finite position'),
    (['a', 'b'], [(0.0, float('nan'))], {}, DataError, 'no finite position'),
    (['a', 'b'], [(0.9, 0.0)], {'max_torque': (5.0,)}, DataError, 'more than allowed'),
])
def test_an_invalid_trajectory_is_refused_and_unchanged(model, names, poses, options, error,
                                                        message):
    plan = trajectory(names, *poses)
    with pytest.raises(error, match=message):
        fill_effort(plan, model, **options)
    assert not any(len(point.effort) for point in plan.points)
