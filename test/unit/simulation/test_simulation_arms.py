"""Simulated arms compared with published figures and analytical torques."""

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation import arms
import numpy as np
import pinocchio as pin
import pytest

LINK = '<link name="{0}"><inertial><origin xyz="{1}"/><mass value="2"/>' \
       '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'


def pendulum(kind: str = 'revolute') -> str:
    """Return a URDF of a 2 kg mass 0.5 m along x from a joint about +y."""
    return (f'<robot name="pendulum"><link name="base"/>{LINK.format("rod", "0.5 0 0")}'
            f'<joint name="swing" type="{kind}"><parent link="base"/><child link="rod"/>'
            '<axis xyz="0 1 0"/><limit lower="-1" upper="2" velocity="3" effort="9"/></joint>'
            '</robot>')


def test_iiwa_gravity_has_the_published_rms():
    arm = arms.iiwa7()
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (20000, 7))
    rms = np.sqrt((arms.gravity_torque(arm, q) ** 2).mean(axis=0))
    published = [0, 58.20, 13.82, 18.40, 1.765, 1.791, 0]
    np.testing.assert_allclose(rms, published, rtol=0.02, atol=1e-12)


def test_iiwa_centres_and_flange_are_those_of_the_data_sheet():
    arm = arms.iiwa7()
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, np.zeros(7))
    heights = [data.oMi[k].translation[2] for k in (2, 4, 6)]
    np.testing.assert_allclose(heights, [0.34, 0.74, 1.14], atol=1e-12)
    assert data.oMi[7].translation[2] + 0.045 == pytest.approx(1.266, abs=5e-4)
    axes = [data.oMi[k].rotation[:, 2] for k in range(1, 8)]
    z, y = np.array([0, 0, 1]), np.array([0, 1, 0])
    np.testing.assert_allclose(axes, [z, y, z, -y, z, y, z], atol=1e-12)


def test_pendulum_torque_is_analytical(tmp_path):
    path = tmp_path / 'pendulum.urdf'
    path.write_text(pendulum())
    arm = arms.from_urdf(path)
    assert arm.joints == ('swing',)
    assert (arm.lower[0], arm.upper[0], arm.max_speed[0]) == (-1, 2, 3)
    q = np.array([[0.0], [0.7]])
    # Rotation about +y lowers a mass on +x, so the gravity torque is negative.
    expected = -2 * 9.80665 * 0.5 * np.cos(q)
    np.testing.assert_allclose(arms.gravity_torque(arm, q), expected, atol=1e-12)
    inertia = 0.01 + 2 * 0.5 ** 2
    moving = arms.inverse_dynamics(arm, q, np.ones((2, 1)), np.full((2, 1), 3.0))
    np.testing.assert_allclose(moving, expected + 3 * inertia, atol=1e-12)


def test_continuous_joint_equals_a_revolute_one(tmp_path):
    path = tmp_path / 'pendulum.urdf'
    path.write_text(pendulum('continuous'))
    arm = arms.from_urdf(path)
    assert (arm.lower[0], arm.upper[0]) == (-np.pi, np.pi)
    q = np.array([[4.0]])
    np.testing.assert_allclose(arms.gravity_torque(arm, q), -9.80665 * np.cos(q), atol=1e-12)


@pytest.mark.parametrize('text', ['', '<robot', '<robot name="x"><link name="a"/></robot>'])
def test_an_invalid_urdf_gives_one_line(tmp_path, text):
    path = tmp_path / 'x.urdf'
    path.write_text(text)
    with pytest.raises(OptionError) as error:
        arms.from_urdf(path)
    assert str(path) in str(error.value)
    assert '\n' not in str(error.value)


def test_payload_adds_its_torque_and_leaves_the_arm_unchanged(tmp_path):
    path = tmp_path / 'pendulum.urdf'
    path.write_text(pendulum())
    bare = arms.from_urdf(path)
    loaded = arms.with_payload(bare, arms.Payload(3.0, (0.0, 0.0, 0.2)))
    q = np.array([[0.4]])
    extra = arms.gravity_torque(loaded, q) - arms.gravity_torque(bare, q)
    np.testing.assert_allclose(extra, -3 * 9.80665 * 0.2 * np.sin(q), atol=1e-12)
    np.testing.assert_allclose(arms.gravity_torque(bare, q), -9.80665 * np.cos(q), atol=1e-12)
    inertial = (arms.inverse_dynamics(loaded, q, [[0.0]], [[1.0]])
                - arms.inverse_dynamics(loaded, q, [[0.0]], [[0.0]]))
    np.testing.assert_allclose(inertial, 0.01 + 0.5 + 3 * 0.04, atol=1e-12)
