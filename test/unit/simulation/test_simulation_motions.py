"""Motions: the paper's formulas, exact derivatives, limits for all time."""

from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.simulation import arms, motions
from gravity_comp_ros.simulation.motions import MultisineOptions
from gravity_comp_ros.simulation.synthesise import (
    NoiseOptions, Signals, synthesise, SynthesisOptions)
from hypothesis import given, settings, strategies as st
import numpy as np
import pinocchio as pin
import pytest

LOW, HIGH, SPEED = np.array([-1.0, -2.0, 0.0]), np.array([1.0, 0.5, 3.0]), np.full(3, 1.5)


def test_eq15_as_printed():
    motion = motions.eq15()
    t = np.arange(200) / 10
    pi = np.pi
    printed = np.stack([
        1.4 * np.sin(0.25 * pi * t), 1.4 * np.sin(0.2 * pi * t), 1.8 * np.sin(0.167 * pi * t),
        1.3 * np.sin(0.25 * pi * t - 0.167 * pi), 3 * np.sin(0.33 * pi * t),
        2 * np.sin(0.167 * pi * t), 3 * np.sin(0.2 * pi * t)], axis=1)
    np.testing.assert_allclose(motion.q, printed, atol=1e-12)
    np.testing.assert_allclose(motion.t, t)


def test_eq17_as_printed():
    motion = motions.eq17()
    t = np.arange(500) / 5
    sin, cos = np.sin, np.cos
    printed = np.stack([
        0.65 * sin(0.1 * t + 1.5), 0.25 * (cos(0.2 * t + 0.2) - cos(0.2)) + 0.5,
        0.5 * (sin(0.2 * t + 0.3) - sin(0.3)), 0.9 * (sin(0.125 * t + 0.2) - sin(0.2)) + 0.25,
        0.25 * sin(0.2 * t), 0.4 * (cos(0.25 * t + 0.4) - cos(0.4)) + 0.25,
        0.25 * (sin(0.2 * t + 0.4) - sin(0.4))], axis=1)
    np.testing.assert_allclose(motion.q, printed, atol=1e-12)
    np.testing.assert_allclose(motion.t, t)


def all_motions():
    return [motions.eq15(), motions.eq17(),
            motions.multisine(LOW, HIGH, SPEED, 5, MultisineOptions(ramp=20.0))]


@pytest.mark.parametrize('motion', all_motions(), ids=lambda m: m.name)
def test_speed_and_acceleration_are_the_derivatives(motion):
    step = 1e-4
    t = motion.t + 0.037  # not at the end of the ramp, where the third derivative jumps
    before, after, here = (motion.path(t + dt) for dt in (-step, step, 0.0))
    for order in (0, 1):
        numeric = (after[order] - before[order]) / (2 * step)
        np.testing.assert_allclose(here[order + 1], numeric, atol=2e-7)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), max_speed=st.floats(0.01, 3.0),
       n_sines=st.integers(1, 8), band=st.floats(0.02, 1.0))
def test_multisine_stays_within_every_limit_for_all_time(seed, max_speed, n_sines, band):
    options = MultisineOptions(max_speed=max_speed, n_sines=n_sines, band=band)
    motion = motions.multisine(LOW, HIGH, SPEED, seed, options, duration=250.0, rate=97.0)
    assert (np.abs(motion.qd) <= np.minimum(max_speed, SPEED) + 1e-12).all()
    assert (motion.q >= LOW).all() and (motion.q <= HIGH).all()
    # Each joint reaches one of its bounds.
    fast = np.abs(motion.qd).max(axis=0) > 0.98 * np.minimum(max_speed, SPEED)
    wide = np.ptp(motion.q, axis=0) > 0.9 * (HIGH - LOW)
    assert (fast | wide).all()


def test_multisine_starts_at_rest_and_continues_as_the_same_motion():
    motion = motions.multisine(LOW, HIGH, SPEED, 7)
    assert not motion.qd[0].any() and not motion.qdd[0].any()
    later = motions.multisine(LOW, HIGH, SPEED, 7, duration=50.0, rate=10.0, start=40.0)
    np.testing.assert_allclose(later.q[:120:2], motion.q[200:260], atol=1e-12)
    other = motions.multisine(LOW, HIGH, SPEED, 8)
    assert np.abs(other.q - motion.q).max() > 0.1


def test_random_poses_are_seeded_at_rest_and_spread_over_the_limits():
    motion = motions.random_poses(LOW, HIGH, 4000, seed=3, period=2.0, start=10.0)
    assert not motion.qd.any() and not motion.qdd.any()
    assert (motion.q >= LOW).all() and (motion.q <= HIGH).all()
    np.testing.assert_allclose(motion.q.mean(axis=0), (LOW + HIGH) / 2, atol=0.06)
    np.testing.assert_allclose(np.diff(motion.t), 2.0)
    np.testing.assert_array_equal(
        motion.q, motions.random_poses(LOW, HIGH, 4000, seed=3).q)
    np.testing.assert_array_equal(motion.path(motion.t + 1.99)[0], motion.q)


def test_a_motion_without_a_sample_is_refused():
    with pytest.raises(OptionError, match='no sample'):
        motions.eq15(duration=0.01)


LINK = '<link name="{0}"><inertial><origin xyz="{1}"/><mass value="2"/>' \
       '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'


def pendulum(folder, kind: str = 'revolute') -> arms.Arm:
    """Return a mass of 2 kg, 0.5 m along x from a joint about +y."""
    path = folder / 'pendulum.urdf'
    path.write_text(
        f'<robot name="pendulum"><link name="base"/>{LINK.format("rod", "0.5 0 0")}'
        f'<joint name="swing" type="{kind}"><parent link="base"/><child link="rod"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="2" velocity="3" effort="9"/></joint>'
        '</robot>')
    return arms.from_urdf(path)


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
    arm = pendulum(tmp_path)
    assert arm.joints == ('swing',)
    assert (arm.lower[0], arm.upper[0], arm.max_speed[0]) == (-1, 2, 3)
    q = np.array([[0.0], [0.7]])
    # Rotation about +y lowers a mass on +x, so the gravity torque is negative.
    expected = -2 * 9.80665 * 0.5 * np.cos(q)
    np.testing.assert_allclose(arms.gravity_torque(arm, q), expected, atol=1e-12)
    inertia = 0.01 + 2 * 0.5 ** 2
    moving = arms.inverse_dynamics(arm, q, np.ones((2, 1)), np.full((2, 1), 3.0))
    np.testing.assert_allclose(moving, expected + 3 * inertia, atol=1e-12)
    # A continuous joint is a revolute one without limits.
    arm = pendulum(tmp_path, 'continuous')
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
    bare = pendulum(tmp_path)
    loaded = arms.with_payload(bare, arms.Payload(3.0, (0.0, 0.0, 0.2)))
    q = np.array([[0.4]])
    extra = arms.gravity_torque(loaded, q) - arms.gravity_torque(bare, q)
    np.testing.assert_allclose(extra, -3 * 9.80665 * 0.2 * np.sin(q), atol=1e-12)
    np.testing.assert_allclose(arms.gravity_torque(bare, q), -9.80665 * np.cos(q), atol=1e-12)
    inertial = (arms.inverse_dynamics(loaded, q, [[0.0]], [[1.0]])
                - arms.inverse_dynamics(loaded, q, [[0.0]], [[0.0]]))
    np.testing.assert_allclose(inertial, 0.01 + 0.5 + 3 * 0.04, atol=1e-12)


ARM = arms.iiwa7()


def test_noise_is_seeded_and_has_the_given_level():
    motion = motions.random_poses(ARM.lower, ARM.upper, 3000, seed=1)
    clean = synthesise(ARM, motion)
    noise = NoiseOptions(relative=0.01)
    one, same, other = (synthesise(ARM, motion, SynthesisOptions(noise=noise, seed=seed))
                        for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.tau, same.tau)
    assert np.abs(one.tau - other.tau).max() > 0.1
    ratio = (one.tau - clean.tau)[:, 1] / clean.tau[:, 1]
    assert ratio.std() == pytest.approx(0.01, rel=0.05)
    absolute = synthesise(ARM, motion, SynthesisOptions(noise=NoiseOptions(absolute=0.1)))
    np.testing.assert_allclose((absolute.tau - clean.tau).std(axis=0), 0.1, rtol=0.06)


class Offset:
    """A sensor offset."""

    def __init__(self, size):
        self.size = size

    def apply(self, signals, motion, arm):
        return Signals(signals.q, signals.qd, signals.tau + self.size)


class Gain:
    """A gain error, to test the order with Offset."""

    def apply(self, signals, motion, arm):
        return Signals(signals.q, signals.qd, 2 * signals.tau)


def test_disturbances_act_in_order_and_do_not_change_the_noise():
    motion = motions.eq17(duration=5)
    noise = NoiseOptions(absolute=0.1)
    clean = synthesise(ARM, motion)
    plain = synthesise(ARM, motion, SynthesisOptions(noise=noise))
    both = synthesise(ARM, motion, SynthesisOptions(
        noise=noise, disturbances=(Offset(3.0), Gain())))
    added = plain.tau - clean.tau
    np.testing.assert_allclose(both.tau, 2 * (clean.tau + 3.0) + added, atol=1e-12)
