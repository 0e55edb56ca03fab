"""Elastic disturbances: balancers, cables, cogging, detents, bumpers, elastic gears."""

from gravity_comp_ros.simulation.arms import gravity_torque, iiwa7
from gravity_comp_ros.simulation.disturbances.joint_torque import (
    Bumper, Cogging, Detent, DressPack, SpringBalancer)
from gravity_comp_ros.simulation.disturbances.signals import Backlash, ElasticGear
from gravity_comp_ros.simulation.motions import multisine, MultisineOptions
from gravity_comp_ros.simulation.synthesise import Signals
import numpy as np
import pytest
from scipy.integrate import trapezoid

ARM = iiwa7()
ANGLES = np.linspace(-2.0, 2.0, 4001)


def test_the_torque_of_a_balancer_without_free_length_is_a_sine():
    balancer = SpringBalancer(1, 1000.0, 0.0, 0.1, 0.6)
    assert balancer.torque(ANGLES) == pytest.approx(60.0 * np.sin(ANGLES))


def test_the_torque_of_a_detent_peaks_one_width_from_its_centre():
    torque = Detent(3, 0.5, 4.0, 0.05).torque(ANGLES)
    assert torque.max() == pytest.approx(4.0, rel=1e-4)
    assert ANGLES[torque.argmax()] == pytest.approx(0.55, abs=1e-3)
    assert np.abs(torque[np.abs(ANGLES - 0.5) > 0.3]).max() < 1e-4


def test_a_dress_pack_is_slack_then_linear_then_hardening():
    pack = DressPack(3, 0.4, 2.0, hardening=1.0)
    assert not pack.torque(ANGLES)[ANGLES <= 0.4].any()
    assert pack.torque(np.array([0.41]))[0] == pytest.approx(0.02, rel=0.01)
    assert pack.torque(np.array([1.4]))[0] == pytest.approx(2.0 * np.expm1(1.0))


def test_cogging_is_periodic_with_zero_mean():
    cogging = Cogging(3, 12, 0.8, 0.3, 0.1)
    q = 2 * np.pi * np.arange(7200) / 7200
    torque = cogging.torque(q)
    assert torque.mean() == pytest.approx(0.0, abs=1e-12)
    assert cogging.torque(np.array([0.1]))[0] == pytest.approx(0.8)
    assert cogging.torque(q + 2 * np.pi / 12) == pytest.approx(torque)
    spectrum = np.abs(np.fft.rfft(torque)) * 2 / len(q)
    assert spectrum[24] > 0.2 * spectrum[12] > 0.01
    assert set(np.flatnonzero(spectrum > 1e-6) % 12) == {0}


def test_a_bumper_pushes_back_and_loses_energy():
    bumper = Bumper(3, 0.9, 30.0, loss=0.8)
    t = np.linspace(0, np.pi, 20001)
    q, qd = 0.8 + 0.4 * np.sin(t), 0.4 * np.cos(t)
    torque = bumper.torque(q, qd)
    assert torque.min() == 0.0 and not torque[q <= 0.9].any()
    assert trapezoid(torque * qd, t) > 0.1
    spring = Bumper(3, 0.9, 30.0, loss=0.0)
    assert trapezoid(spring.torque(q, qd) * qd, t) == pytest.approx(0.0, abs=1e-6)
    mirrored = Bumper(3, -0.9, 30.0, side=-1, loss=0.8)
    assert mirrored.torque(-q, -qd) == pytest.approx(-torque)


def motion_and_gravity():
    motion = multisine(ARM.lower, ARM.upper, ARM.max_speed, 1, MultisineOptions(max_speed=0.3),
                       60.0, 100.0)
    return motion, Signals(motion.q, motion.qd, gravity_torque(ARM, motion.q))


@pytest.mark.parametrize('hardening', [0.0, 1e-3])
def test_the_wind_up_of_an_elastic_gear_transmits_the_load(hardening):
    motion, signals = motion_and_gravity()
    out = ElasticGear(1, 5000.0, hardening).apply(signals, motion, ARM, np.random.default_rng(0))
    wound = out.q[:, 1] - motion.q[:, 1]
    carried = 5000.0 * wound / np.sqrt(1 - hardening * (5000.0 * wound) ** 2)
    assert carried == pytest.approx(signals.tau[:, 1], rel=1e-6)
    assert np.array_equal(out.tau, signals.tau)
    assert out.qd[1:-1, 1] == pytest.approx(np.gradient(out.q[:, 1], motion.t)[1:-1], abs=1e-3)


def test_backlash_follows_the_sign_of_the_load():
    t = np.arange(0.0, 4.0, 0.01)
    load = 5.0 * np.cos(np.pi * t / 2)
    lead = Backlash(1, 0.02, threshold=0.5, crossing=0.05).lead(t, load)
    assert lead[load > 1.0] == pytest.approx(0.01)
    # The load passes -0.5 N·m at t = 1.064 s; the contact has changed 0.05 s later.
    assert lead[t < 1.05] == pytest.approx(0.01)
    assert lead[(t > 1.13) & (t < 3.0)] == pytest.approx(-0.01)
    assert np.abs(np.diff(lead)).max() <= 0.02 * 0.01 / 0.05 + 1e-12
