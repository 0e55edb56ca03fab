"""Disturbances of sensors, base and tool; pauses, sensor noise and the six-axis arm."""

from bench.cases.arms import six_axis
from bench.cases.signals import ornstein_uhlenbeck, Pause, with_pauses
from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
from gravity_comp_ros.simulation.disturbances import signals as d
from gravity_comp_ros.simulation.motions import (
    Motion, multisine, MultisineOptions, random_poses)
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pinocchio as pin
import pytest

ARM = iiwa7()


def motion_and_signals(rate=100.0, duration=40.0):
    motion = multisine(ARM.lower, ARM.upper, ARM.max_speed, 1, MultisineOptions(max_speed=0.3),
                       duration, rate)
    return motion, Signals(motion.q, motion.qd, gravity_torque(ARM, motion.q))


def apply(disturbance, **how):
    motion, signals = motion_and_signals(**how)
    return motion, signals, disturbance.apply(signals, motion, ARM)


def test_offset_and_gain_of_a_torque_sensor():
    _, before, after = apply(d.gauge_offset(2, -0.7))
    assert (after.tau - before.tau)[:, 2] == pytest.approx(-0.7)
    _, before, after = apply(d.gauge_gain(1, 1.1))
    assert after.tau[:, 1] == pytest.approx(1.1 * before.tau[:, 1])
    assert np.array_equal(np.delete(after.tau, 1, 1), np.delete(before.tau, 1, 1))


def test_a_torque_sensor_drifts_as_it_warms():
    motion, before, after = apply(d.gauge_drift(2, 0.5, 20.0), duration=100.0)
    drift = (after.tau - before.tau)[:, 2]
    assert drift[0] == pytest.approx(0.0) and drift[-1] == pytest.approx(0.5, abs=0.01)
    assert drift[2000] == pytest.approx(0.5 * (1 - np.exp(-1)), rel=1e-3)


def test_a_torque_sensor_follows_the_temperature_of_its_mount():
    # With the mount at 1 - exp(-t / w), the sensor follows lag w dx/dt = mount - x.
    motion, before, after = apply(d.gauge_drift(2, 1.0, 20.0, begun=3.0, lag=0.25), duration=100.0)
    drift = (after.tau - before.tau)[:, 2]
    age = motion.t - motion.t[0] + 3.0
    rate = np.gradient(drift, motion.t)
    mount = 1.0 - np.exp(-age / 20.0)
    assert 0.25 * 20.0 * rate[1:-1] == pytest.approx((mount - drift)[1:-1], abs=1e-5)


def test_delayed_effort_is_interpolated_linearly():
    motion, before, after = apply(d.delayed_effort(0.025))
    halfway = 0.5 * (before.tau[:-3] + before.tau[1:-2])
    assert after.tau[3:] == pytest.approx(halfway)


def test_an_encoder_offset_changes_the_angle_and_not_the_torque():
    _, before, after = apply(d.encoder_offset(3, 0.05))
    assert after.q[:, 3] - before.q[:, 3] == pytest.approx(0.05)
    assert np.array_equal(after.tau, before.tau)


def test_a_tilted_base_rotates_gravity():
    motion, before, after = apply(d.tilted_base(0.2))
    # Reference: the arm with a rotated base, and vertical gravity.
    model = ARM.model.copy()
    base = pin.rpy.rpyToMatrix(0.2, 0.0, 0.0)
    model.jointPlacements[1] = pin.SE3(base, np.zeros(3)) * model.jointPlacements[1]
    data = model.createData()
    expected = np.array([pin.computeGeneralizedGravity(model, data, q) for q in motion.q[::50]])
    assert after.tau[::50] == pytest.approx(expected, abs=1e-9)
    assert np.abs(after.tau[:, 0]).max() > 1.0


@pytest.mark.parametrize('arm', [iiwa7(), six_axis()], ids=['iiwa7', 'six_axis'])
def test_drives_and_tool_force_do_opposite_work(arm):
    force, point = (6.0, 3.0, -12.0), (0.05, 0.0, 0.1)
    motion = random_poses(arm.lower, arm.upper, 20, 3)
    torques = d.tool_force(force, point).apply(
        Signals(motion.q, motion.qd, np.zeros_like(motion.q)), motion, arm).tau
    step, rng = 1e-6, np.random.default_rng(1)
    model, data = arm.model, arm.model.createData()
    for pose, torque in zip(motion.q, torques):
        direction = rng.standard_normal(arm.n_joints)
        points = []
        for side in (-1, 1):
            pin.forwardKinematics(model, data, pose + side * step * direction)
            points.append(data.oMi[model.njoints - 1].act(np.array(point)))
        pin.forwardKinematics(model, data, pose)
        pull = data.oMi[model.njoints - 1].rotation @ np.array(force)
        work = pull @ (points[1] - points[0]) / (2 * step)
        assert torque @ direction == pytest.approx(-work, abs=1e-4)


def test_a_motion_continues_after_a_pause():
    motion, _ = motion_and_signals()
    paused = with_pauses(motion, (Pause(10.0, 3.0), Pause(25.0, 1.0, 0.5)))
    resting = (paused.t > 11.0) & (paused.t < 14.0)
    assert np.abs(paused.qd[resting]).max() < 1e-12
    assert np.ptp(paused.q[resting], axis=0).max() < 1e-9
    # Each pause takes its rest and half of either ramp.
    assert paused.path(np.array([20.0]))[0] == pytest.approx(motion.path(np.array([16.0]))[0])
    assert paused.path(np.array([38.0]))[0] == pytest.approx(motion.path(np.array([32.5]))[0])
    assert np.array_equal(paused.q[paused.t < 10], motion.q[motion.t < 10])


def test_correlated_noise_has_its_correlation_time():
    rng = np.random.default_rng(5)
    noise = ornstein_uhlenbeck(rng.standard_normal((400000, 1)), 0.02, 0.5)[:, 0]
    assert noise.std() == pytest.approx(1.0, rel=0.02)
    lag = 25  # 0.5 s
    assert np.mean(noise[lag:] * noise[:-lag]) == pytest.approx(np.exp(-1), abs=0.03)


def test_the_six_axis_arm_has_three_parallel_axes_and_its_mass():
    arm = six_axis()
    data = arm.model.createData()
    pin.forwardKinematics(arm.model, data, random_poses(arm.lower, arm.upper, 1, 4).q[0])
    axes = [data.oMi[k].rotation[:, 2] for k in range(1, 7)]
    assert axes[1] == pytest.approx(axes[2]) and axes[2] == pytest.approx(axes[3])
    assert abs(axes[0] @ axes[1]) < 1e-12 and abs(axes[3] @ axes[4]) < 1e-12
    assert pin.computeTotalMass(arm.model) == pytest.approx(28.69)
    # Stretched out horizontally: sum of weight times distance of the links.
    stretched = gravity_torque(arm, np.zeros((1, 6)))[0, 1]
    moment = (12.7 * 0.232 + 4.27 * (0.612 + 0.331) + 2.0 * (1.184 - 0.003)
              + 2.0 * (1.184 + 0.003) + 0.62 * 1.184)
    assert stretched == pytest.approx(-9.80665 * moment, rel=0.01)


ANGLES = np.linspace(-2.0, 2.0, 4001)


def of_angle(disturbance, q=ANGLES):
    """Return the torque that is added to that of joint 1 at angles (K,) of the joint."""
    q = np.tile(np.asarray(q)[:, None], 7)
    motion = Motion('', np.arange(len(q)), q, 0.0 * q, 0.0 * q, None)
    return disturbance.apply(Signals(q, q, 0.0 * q), motion, ARM).tau[:, 1]


def test_torques_of_balancer_detent_dress_pack_and_bumper():
    torque = of_angle(d.spring_balancer(1, 8.0))
    assert np.interp([0.0, 1.0], ANGLES, torque) == pytest.approx([0.0, 8.0], abs=1e-9)
    assert torque == pytest.approx(-torque[::-1])
    # The torque of a detent peaks one width from its centre.
    torque = of_angle(d.detent(1, 0.5, 4.0, 0.05))
    assert torque.max() == pytest.approx(4.0, rel=1e-4)
    assert ANGLES[torque.argmax()] == pytest.approx(0.55, abs=1e-3)
    assert np.abs(torque[np.abs(ANGLES - 0.5) > 0.3]).max() < 1e-4
    # A dress pack is slack, then linear, then hardening.
    pack = d.dress_pack(1, 0.4, 2.0, hardening=1.0)
    assert not of_angle(pack)[ANGLES <= 0.4].any()
    assert of_angle(pack, [0.41, 1.4]) == pytest.approx([0.02, 2.0 * np.expm1(1.0)], rel=0.01)
    assert of_angle(d.bumper(1, 0.9, 30.0), [0.8, 1.9]) == pytest.approx([0.0, 30.0])


def test_cogging_is_periodic_with_zero_mean():
    cogging, q = d.cogging(1, 12, 0.8, 0.3, 0.1), 2 * np.pi * np.arange(7200) / 7200
    torque = of_angle(cogging, q)
    assert torque.mean() == pytest.approx(0.0, abs=1e-12)
    assert of_angle(cogging, [0.1])[0] == pytest.approx(0.8)
    spectrum = np.abs(np.fft.rfft(torque)) * 2 / len(q)
    assert spectrum[24] > 0.2 * spectrum[12] > 0.01
    assert set(np.flatnonzero(spectrum > 1e-6) % 12) == {0}


def test_the_wind_up_of_an_elastic_gear_transmits_the_load():
    motion, signals, out = apply(d.gear(1, lambda load: load / 5000.0))
    assert 5000.0 * (out.q - motion.q)[:, 1] == pytest.approx(signals.tau[:, 1], rel=1e-6)
    assert np.array_equal(out.tau, signals.tau)
    assert out.qd[1:-1, 1] == pytest.approx(np.gradient(out.q[:, 1], motion.t)[1:-1], abs=1e-3)
